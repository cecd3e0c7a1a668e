//! Size, area, volume and the like.
//!
//! Guarantees: sums are compensated (Neumaier, "Rundungsfehleranalyse einiger Verfahren zur Summation endlicher Summen",
//! 1974) and taken in the order of triangles in blocks of fixed size, so that they do not depend on the number of
//! threads; volumes are taken relative to the middle of the mesh, so that a shift costs no digits.
//! Does not guarantee: a meaning of the volume if the mesh is not closed and oriented; ask `check`.
//! Cost: O(n), about 10 ns a triangle and core.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::TriMesh;

/// Measures of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// The smallest coordinates of the triangles; zero if there are none.
    pub min: DVec3,
    /// The largest coordinates of the triangles; zero if there are none.
    pub max: DVec3,
    /// The length of the diagonal from `min` to `max`.
    pub diagonal: f64,
    /// The sum of the areas of the triangles.
    pub area: f64,
    /// The volume enclosed, positive if triangles run counter-clockwise as seen from outside. Overlapping parts count
    /// as often as they are wound around; of an open mesh, the volume of the cone from the middle of its box.
    pub volume: f64,
    /// The center of mass of the surface; the middle of the box if the area is 0.
    pub area_centroid: DVec3,
    /// The center of mass of what is enclosed; `None` if the volume is 0 within rounding.
    pub volume_centroid: Option<DVec3>,
    /// Lengths of the triangles' sides; an edge that two triangles share counts twice.
    pub side_lengths: SideLengths,
}

/// The spread of the lengths of sides.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SideLengths {
    /// The shortest; 0 if there are none.
    pub min: f64,
    /// The mean; 0 if there are none.
    pub mean: f64,
    /// The longest; 0 if there are none.
    pub max: f64,
    /// The standard deviation; 0 if there are none.
    pub deviation: f64,
}

/// Triangles in a block that is summed by one thread. The result depends on it in the last digit only.
const BLOCK: usize = 4096;

/// A sum that keeps what rounding cuts off.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    #[inline]
    fn add(&mut self, x: f64) {
        let total = self.sum + x;
        self.lost += if self.sum.abs() >= x.abs() {
            (self.sum - total) + x
        } else {
            (x - total) + self.sum
        };
        self.sum = total;
    }

    fn join(&mut self, other: Self) {
        self.add(other.sum);
        self.lost += other.lost;
    }

    fn value(self) -> f64 {
        self.sum + self.lost
    }
}

#[derive(Debug, Clone, Copy)]
struct Sums {
    area: Sum,
    volume: Sum,
    area_moment: [Sum; 3],
    volume_moment: [Sum; 3],
    length: Sum,
    length_sq: Sum,
    volume_size: f64,
    shortest: f64,
    longest: f64,
}

impl Sums {
    fn new() -> Self {
        Self {
            area: Sum::default(),
            volume: Sum::default(),
            area_moment: [Sum::default(); 3],
            volume_moment: [Sum::default(); 3],
            length: Sum::default(),
            length_sq: Sum::default(),
            volume_size: 0.0,
            shortest: f64::INFINITY,
            longest: 0.0,
        }
    }

    fn add(&mut self, [a, b, c]: [DVec3; 3]) {
        let normal = (b - a).cross(c - a);
        let (area, volume) = (0.5 * normal.length(), a.dot(normal) / 6.0);
        let corners = a + b + c;
        self.area.add(area);
        self.volume.add(volume);
        self.volume_size += volume.abs();
        for axis in 0..3 {
            self.area_moment[axis].add(area * corners[axis] / 3.0);
            self.volume_moment[axis].add(volume * corners[axis] / 4.0);
        }
        for length in [a.distance(b), b.distance(c), c.distance(a)] {
            self.length.add(length);
            self.length_sq.add(length * length);
            self.shortest = self.shortest.min(length);
            self.longest = self.longest.max(length);
        }
    }

    fn join(mut self, other: &Self) -> Self {
        self.area.join(other.area);
        self.volume.join(other.volume);
        self.volume_size += other.volume_size;
        for axis in 0..3 {
            self.area_moment[axis].join(other.area_moment[axis]);
            self.volume_moment[axis].join(other.volume_moment[axis]);
        }
        self.length.join(other.length);
        self.length_sq.join(other.length_sq);
        self.shortest = self.shortest.min(other.shortest);
        self.longest = self.longest.max(other.longest);
        self
    }
}

/// Measures `mesh`.
///
/// ```
/// use glam::DVec3;
/// use ravec_mesh::{TriMesh, measure};
///
/// let corner = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
/// let mesh = TriMesh::new(corner, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
/// assert!((measure(&mesh).volume - 1.0 / 6.0).abs() < 1e-15);
/// # Ok::<(), ravec_mesh::MeshError>(())
/// ```
#[expect(clippy::missing_panics_doc, reason = "nobody cancels")]
pub fn measure(mesh: &TriMesh) -> Measures {
    try_measure(mesh, &Progress::none()).expect("nobody can cancel it")
}

/// Measures `mesh`, which takes more than a moment if it is large.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn try_measure(mesh: &TriMesh, progress: &Progress) -> Result<Measures, Cancelled> {
    progress.check()?;
    let bounds = mesh.bounds();
    if bounds.is_empty() {
        return Ok(Measures {
            min: DVec3::ZERO,
            max: DVec3::ZERO,
            diagonal: 0.0,
            area: 0.0,
            volume: 0.0,
            area_centroid: DVec3::ZERO,
            volume_centroid: None,
            side_lengths: SideLengths {
                min: 0.0,
                mean: 0.0,
                max: 0.0,
                deviation: 0.0,
            },
        });
    }
    let (middle, positions) = (bounds.center(), mesh.positions());
    let blocks: Vec<Sums> = mesh
        .triangles()
        .par_chunks(BLOCK)
        .map(|block| {
            progress.check()?;
            let mut sums = Sums::new();
            for t in block {
                sums.add(t.map(|v| positions[v as usize] - middle));
            }
            Ok(sums)
        })
        .collect::<Result<_, Cancelled>>()?;
    let sums = blocks.iter().fold(Sums::new(), Sums::join);
    let moment = |moment: [Sum; 3]| DVec3::from_array(moment.map(Sum::value));
    let (area, volume) = (sums.area.value(), sums.volume.value());
    let sides = 3.0 * mesh.triangles().len() as f64;
    let mean = sums.length.value() / sides;
    let variance = sums.length_sq.value() / sides - mean * mean;
    // each term has a few roundings of half an ulp
    let meaningful = volume.abs() > 1e-14 * sums.volume_size;
    Ok(Measures {
        min: bounds.min,
        max: bounds.max,
        diagonal: bounds.diagonal(),
        area,
        volume,
        area_centroid: if area > 0.0 {
            middle + moment(sums.area_moment) / area
        } else {
            middle
        },
        volume_centroid: meaningful.then(|| middle + moment(sums.volume_moment) / volume),
        side_lengths: SideLengths {
            min: sums.shortest,
            mean,
            max: sums.longest,
            deviation: variance.max(0.0).sqrt(),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The box from the origin to `size`, with its corners moved by `shift`.
    fn block(size: DVec3, shift: DVec3) -> TriMesh {
        let positions = (0..8)
            .map(|k| {
                let bits = [k & 1, k >> 1 & 1, k >> 2].map(f64::from);
                DVec3::from_array(bits) * size + shift
            })
            .collect();
        let quads: [[u32; 4]; 6] = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let triangles = quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
        TriMesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn a_box_has_the_measures_of_a_box_also_far_away() {
        for shift in [DVec3::ZERO, DVec3::new(1048576.0, -2097152.0, 524288.0)] {
            let size = DVec3::new(2.0, 3.0, 5.0);
            let found = measure(&block(size, shift));
            assert_eq!(found.volume, 30.0);
            assert_eq!(found.area, 62.0);
            assert_eq!(found.min, shift);
            assert_eq!(found.max, shift + size);
            assert!((found.area_centroid - shift - size / 2.0).length() < 1e-9);
            let centroid = found.volume_centroid.unwrap();
            assert!((centroid - shift - size / 2.0).length() < 1e-9);
            assert_eq!(found.side_lengths.min, 2.0);
            assert_eq!(found.side_lengths.max, 34_f64.sqrt());
        }
    }

    #[test]
    fn an_empty_mesh_and_a_flat_one_have_no_volume() {
        let empty = measure(&TriMesh::default());
        assert_eq!((empty.area, empty.volume_centroid), (0.0, None));
        let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let sheet = measure(&TriMesh::new(corners, vec![[0, 1, 2]]).unwrap());
        assert_eq!((sheet.area, sheet.volume), (0.5, 0.0));
        assert_eq!(sheet.volume_centroid, None);
        let point = measure(&TriMesh::new(vec![DVec3::ONE], vec![[0, 0, 0]]).unwrap());
        assert_eq!((point.area, point.area_centroid), (0.0, DVec3::ONE));
    }

    #[test]
    fn a_flipped_mesh_has_the_opposite_volume() {
        let mesh = block(DVec3::ONE, DVec3::ZERO);
        let (positions, triangles) = mesh.into_parts();
        let flipped = triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
        let found = measure(&TriMesh::new(positions, flipped).unwrap());
        assert_eq!(found.volume, -1.0);
    }

    #[test]
    fn small_terms_are_not_lost_beside_large_ones() {
        let mut sum = Sum::default();
        sum.add(1e16);
        (0..1000).for_each(|_| sum.add(1.0));
        sum.add(-1e16);
        assert_eq!(sum.value(), 1000.0);
    }
}
