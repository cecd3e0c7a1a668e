//! Smaller triangles for the same surface, so that numbers at vertices show what happens between them.

use ravec::mesh::TriMesh;
use ravec::progress::{Cancelled, Progress};
use std::collections::HashMap;

/// Batch size between cancellation checks, in triangles.
const AT_ONCE: usize = 1 << 14;

/// The mesh with edges halved until none is longer than `longest`, or until there would be more than `most` triangles.
///
/// The vertices of the mesh stay and come first. Edges are halved for both of their triangles alike, so that no cracks open.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// Never: middles of edges lie between finite places.
pub fn refined(
    mesh: TriMesh,
    longest: f64,
    most: usize,
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    let (mut positions, mut triangles) = mesh.into_parts();
    loop {
        progress.check()?;
        let is_long = |positions: &[glam::DVec3], a: u32, b: u32| {
            positions[a as usize].distance_squared(positions[b as usize]) > longest * longest
        };
        let halved = |t: &[u32; 3]| {
            let sides = (0..3).map(|i| is_long(&positions, t[i], t[(i + 1) % 3]));
            sides.filter(|long| *long).count()
        };
        let more: usize = triangles.iter().map(halved).sum();
        if more == 0 || triangles.len() + more > most {
            break;
        }
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut next = Vec::with_capacity(triangles.len() + more);
        for (i, t) in triangles.into_iter().enumerate() {
            if i.is_multiple_of(AT_ONCE) {
                progress.check()?;
            }
            let middle = [0, 1, 2].map(|i| {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                is_long(&positions, a, b).then(|| {
                    *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                        positions.push(0.5 * (positions[a as usize] + positions[b as usize]));
                        positions.len() as u32 - 1
                    })
                })
            });
            split(t, middle, &mut next);
        }
        triangles = next;
    }
    let refined = TriMesh::try_new(positions, triangles, progress)?;
    Ok(refined.expect("middles of edges lie between finite places"))
}

/// A triangle cut at the middles of some of its sides, the first of which is that from its first to its second corner.
fn split(t: [u32; 3], middle: [Option<u32>; 3], out: &mut Vec<[u32; 3]>) {
    // turned so that the case is one of the four below
    let turned = |by: usize| [0, 1, 2].map(|i| t[(i + by) % 3]);
    match middle {
        [None, None, None] => out.push(t),
        [Some(ab), Some(bc), Some(ca)] => {
            let [a, b, c] = t;
            out.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        [Some(m), None, None] => one(turned(0), m, out),
        [None, Some(m), None] => one(turned(1), m, out),
        [None, None, Some(m)] => one(turned(2), m, out),
        [Some(m), Some(n), None] => two(turned(0), m, n, out),
        [None, Some(m), Some(n)] => two(turned(1), m, n, out),
        [Some(n), None, Some(m)] => two(turned(2), m, n, out),
    }
}

/// The first side is cut.
fn one([a, b, c]: [u32; 3], ab: u32, out: &mut Vec<[u32; 3]>) {
    out.extend([[a, ab, c], [ab, b, c]]);
}

/// The first and the second side are cut.
fn two([a, b, c]: [u32; 3], ab: u32, bc: u32, out: &mut Vec<[u32; 3]>) {
    out.extend([[a, ab, c], [ab, b, bc], [ab, bc, c]]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::mesh::{CheckParams, check, measure};
    use ravec_scenes::solids::{cuboid, wedge};

    #[test]
    fn the_surface_stays_closed_and_as_large_while_edges_become_short() {
        for mesh in [
            cuboid([3.0, 1.0, 0.2].into()).mesh,
            wedge(0.3, 1.0, 2.0).mesh,
        ] {
            let before = measure(&mesh);
            let fine = refined(mesh.clone(), 0.11, usize::MAX, &Progress::none()).unwrap();
            let after = measure(&fine);
            assert!(after.side_lengths.max <= 0.11);
            assert!((after.area - before.area).abs() < 1e-12 * before.area);
            assert!((after.volume - before.volume).abs() < 1e-12);
            let found = check(&fine, &CheckParams::default(), &Progress::none()).unwrap();
            assert!(found.is_solid());
            let kept = &fine.positions()[..mesh.positions().len()];
            assert_eq!(kept, mesh.positions());
        }
    }

    #[test]
    fn there_are_no_more_triangles_than_wanted() {
        let fine = refined(cuboid([1.0; 3].into()).mesh, 1e-3, 5000, &Progress::none()).unwrap();
        let count = fine.triangles().len();
        assert!(count > 1000 && count <= 5000, "{count}");
    }
}
