//! The places where triangles meet, by name.

use ravec_mesh::{Sign, orient3d};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::contact::{Contact, Crossing};
use super::places::Places;
use super::point::{Definition, Point};
use super::soup::Soup;

/// Gives each crossing the name of its place.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn name_crossings(
    soup: &Soup,
    contacts: &[(u32, u32, Contact)],
    places: &mut Places,
    progress: &Progress,
) -> Result<FxHashMap<Crossing, u32>, Cancelled> {
    let mut crossings: Vec<(Crossing, [u32; 2])> = contacts
        .iter()
        .flat_map(|&(a, b, contact)| {
            let found = match contact {
                Contact::Coplanar => [None, None],
                Contact::Point(one) => [Some(one), None],
                Contact::Segment(one, other) => [Some(one), Some(other)],
            };
            found.into_iter().flatten().map(move |c| (c, [a, b]))
        })
        .collect();
    crossings.par_sort_unstable();
    crossings.dedup_by_key(|c| c.0);
    let (grid, max_width) = (places.grid(), places.max_width());
    let made: Vec<Option<Point>> = crossings
        .par_iter()
        .map(|&(crossing, between)| {
            progress.check()?;
            let definition = define(soup, crossing, between);
            Ok(definition.map(|definition| Point::defined(definition, max_width, grid)))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut names = FxHashMap::default();
    names.reserve(crossings.len());
    // vertices sort first, so that a place where there is one gets its name
    for ((crossing, _), point) in crossings.into_iter().zip(made) {
        progress.check()?;
        let name = match (crossing, point) {
            (Crossing::Vertex(v), _) => {
                places.announce(v);
                v
            }
            (_, Some(point)) => places.name(point),
            (_, None) => unreachable!("every crossing but a vertex has a definition"),
        };
        names.insert(crossing, name);
    }
    Ok(names)
}

/// The line and the plane that meet in a crossing of two triangles.
fn define(soup: &Soup, crossing: Crossing, between: [u32; 2]) -> Option<Definition> {
    let ends = |edge: [u32; 2]| edge.map(|v| soup.positions[v as usize]);
    match crossing {
        Crossing::Vertex(_) => None,
        Crossing::EdgeTriangle(edge, triangle) => {
            Some(Definition::LinePlane(ends(edge), soup.corners(triangle)))
        }
        Crossing::Edges(e, f) => {
            // one of the edges goes from one side of the other's triangle to the other side
            for (edge, other) in [(e, f), (f, e)] {
                for triangle in between {
                    let corners = &soup.triangles[triangle as usize];
                    let [a, b, c] = soup.corners(triangle);
                    let [p, q] = ends(edge);
                    let (side, opposite) = (orient3d(a, b, c, p), orient3d(a, b, c, q));
                    if other.iter().all(|v| corners.contains(v))
                        && side != Sign::Zero
                        && side == -opposite
                    {
                        return Some(Definition::LinePlane([p, q], [a, b, c]));
                    }
                }
            }
            None
        }
    }
}

/// The edge of a triangle that a crossing is on by its name.
pub(crate) fn edge_with(corners: &[u32; 3], crossing: Crossing) -> Option<[u32; 2]> {
    let edges = match crossing {
        Crossing::Vertex(_) => [None, None],
        Crossing::EdgeTriangle(edge, _) => [Some(edge), None],
        Crossing::Edges(one, other) => [Some(one), Some(other)],
    };
    let is_own = |edge: &[u32; 2]| edge.iter().all(|v| corners.contains(v));
    edges.into_iter().flatten().find(is_own)
}
