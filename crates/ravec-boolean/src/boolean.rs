//! The whole way from meshes and an expression to the result.

mod doubts;
mod inputs;
mod rule;
mod sheets;

use glam::DVec3;
use ravec_mesh::{Aabb, CandidateTree, Coordinates, TriMesh};
use ravec_progress::{Cancelled, Progress};

use crate::arrangement::{Cells, Edges, Pieces, Soup, cut, one_for_each_place, testable, uncut};
use crate::closing::base_level;
use crate::expr::Expr;
use crate::finish::{Finished, finish, split_edges};
use crate::near::{coarsened, merge_near};
use crate::params::{
    Boolean, BooleanError, BooleanParams, BooleanReport, CloseRule, Inside, Origin,
};
use crate::repair::{repair, round_to};
use crate::select::{Draft, Parent, select};
use crate::separate::{Separated, separate};
use doubts::{doubt, doubt_dropped, doubt_empty};
use inputs::{Inputs, prepare};
use rule::Rule;
use sheets::{sheets_to_trim, trim_sheets};

/// The largest coordinate for which all products of the exact tests stay within doubles.
const MAX_COORDINATE: f64 = 1e30;

/// Bound on the rounds in which edges that two sheets share are split. One round is enough unless repair makes new
/// ones.
const MAX_SPLITS: u32 = 8;

/// The least extent that a mesh may have, far above the coordinates that are taken for zero.
const MIN_EXTENT: f64 = 1e-50;

/// Coarsening of the input after a result that cannot be rounded without self-intersections. Numbers are in units of
/// the last place of the largest coordinate, as a double.
#[derive(Clone, Copy)]
enum Coarser {
    /// Merges what is nearer than that.
    MergeNear(f64),
    /// Puts vertices on a grid with such steps.
    Grid(f64),
}

/// Distance within which vertices are merged that make triangles meet, while the input is as it was given, in units of the
/// last place of the numbers of the result. Afterwards it is at least twice the number above.
fn first_reach(coordinates: Coordinates) -> f64 {
    match coordinates {
        Coordinates::Double => 8.0,
        Coordinates::Single => 2.0,
    }
}

/// Attempts for results of doubles, in this order. The last moves vertices by some billionths of the size, less than rounding
/// to 32-bit floats does.
const COARSER: [Coarser; 3] = [
    Coarser::MergeNear(64.0),
    Coarser::Grid(65536.0),
    Coarser::Grid(16_777_216.0),
];

/// Attempts for results of 32-bit floats: the last ones move vertices by some units in the last place of these.
const COARSER_SINGLE: [Coarser; 6] = [
    Coarser::MergeNear(64.0),
    Coarser::Grid(16_777_216.0),
    Coarser::Grid(1_073_741_824.0),
    Coarser::Grid(2_147_483_648.0),
    Coarser::Grid(4_294_967_296.0),
    Coarser::Grid(8_589_934_592.0),
];

/// Bytes that a triangle of the input costs, as measured with surfaces that meet in curves, of which few triangles are cut: 165
/// to 210, the input among them.
const BYTES_PER_TRIANGLE: u64 = 250;

/// Bytes that a pair of triangles that meet costs on top of that: 1000 to 1070 for a hundred spheres and for gears in one plane.
const BYTES_PER_PAIR: u64 = 1100;

/// The surface of what an expression over meshes says is inside.
///
/// Meshes may be any triangles at all. Those that are closed stand for what they wind around; others are closed first, and
/// the report says so. Where the result lies in open sheets alone, as in sheet - solid, these are trimmed, and the result is open.
///
/// # Errors
/// [`BooleanError::NoSuchMesh`], [`BooleanError::OutOfRange`], [`BooleanError::OutOfMemory`],
/// [`BooleanError::NotARelief`], [`BooleanError::NothingToTrim`], [`BooleanError::Undecided`], and
/// [`BooleanError::Cancelled`] soon after `progress` is.
///
/// # Panics
/// If an input has more than about a billion triangles.
pub fn boolean(
    meshes: &[TriMesh],
    expr: &Expr,
    params: &BooleanParams,
    progress: &Progress,
) -> Result<Boolean, BooleanError> {
    let expr = check(meshes, expr, params)?;
    let mut report = BooleanReport::default();
    let mut inputs = prepare(meshes, params, &mut report, progress)?;
    let sheets = sheets_to_trim(&expr.flattened, params, &mut inputs, &mut report)?;
    let result = if sheets.is_empty() {
        inputs.keep(&expr, &mut report);
        combine(&inputs, &expr.pruned, params, &mut report, progress)?
    } else {
        trim_sheets(
            &inputs,
            &expr.flattened,
            &sheets,
            params,
            &mut report,
            progress,
        )?
    };
    let Surface {
        soup,
        parents,
        finished,
    } = result;
    progress.check()?;
    let is_sound = is_sound(&finished, &report);
    let mut origins = origins(&parents, &soup, &inputs);
    progress.check()?;
    let mesh = TriMesh::new(finished.positions, finished.triangles)
        .expect("vertices were numbered as they were used");
    if report.rounded > 0.0 || report.separated > 0 {
        mark_whole(&mut origins, &mesh, meshes, params.coordinates);
    }
    report.triangles = mesh.triangles().len() as u64;
    report.kept_triangles = origins.iter().filter(|o| o.whole).count() as u64;
    report.solid = is_sound && !report.trimmed;
    progress.check()?;
    let measures = ravec_mesh::measure(&mesh);
    report.area = measures.area;
    report.volume = if report.trimmed { 0.0 } else { measures.volume };
    doubt(&mut report, &expr.named, params.close);
    Ok(Boolean {
        mesh,
        origins,
        feature_edges: finished.features,
        report,
    })
}

/// Returns `true` if a result is the surface of a solid for the readers of its format.
fn is_sound(finished: &Finished, report: &BooleanReport) -> bool {
    finished.closed && report.self_intersections == 0 && report.shared_places == 0
}

/// Gives each vertex of a result without self-intersections a place of its own.
fn keep_apart(
    finished: &mut Finished,
    params: &BooleanParams,
    report: &mut BooleanReport,
    progress: &Progress,
) -> Result<(), Cancelled> {
    report.shared_places = 0;
    let separated = if is_sound(finished, report) {
        separate(finished, params.coordinates, progress)?
    } else {
        Separated::default()
    };
    report.separated = separated.vertices;
    report.separation = separated.moved;
    report.shared_places = separated.shared;
    report.self_intersections += separated.faults;
    Ok(())
}

/// The result, and the soup that the parents of its triangles are named after.
struct Surface {
    soup: Soup,
    parents: Vec<Parent>,
    finished: Finished,
}

/// Cuts meshes along each other and keeps what bounds the inside.
fn combine(
    inputs: &Inputs,
    expr: &Expr,
    params: &BooleanParams,
    report: &mut BooleanReport,
    progress: &Progress,
) -> Result<Surface, BooleanError> {
    let given = inputs.soup(progress)?;
    let largest = given.positions.iter().map(|p| p.abs().max_element());
    let ulp = largest.fold(0.0, f64::max) * f64::EPSILON;
    let mut soup = given;
    let own_ulp = ulp / f64::EPSILON * params.coordinates.epsilon();
    let first_reach = first_reach(params.coordinates) * own_ulp;
    let mut reach = first_reach;
    let mut coarser = match params.coordinates {
        Coordinates::Double => COARSER.iter(),
        Coordinates::Single => COARSER_SINGLE.iter(),
    };
    let mut is_first = true;
    loop {
        let tree = soup.tree(progress)?;
        let draft = {
            let pieces = cut(&soup, &tree, None, progress)?;
            within_memory(
                soup.triangles.len() as u64,
                pieces.contacts.len() as u64,
                params,
            )?;
            count_contacts(&pieces, report);
            let hulls = params.inside == Inside::OuterHull;
            let cells = Cells::of(&pieces, &tree, hulls, progress)?;
            let rule = Rule::new(&cells, inputs.meshes.len(), params.inside);
            if std::mem::take(&mut is_first) {
                let meshes = expr.meshes();
                doubt_empty(&rule, &meshes, report);
                doubt_dropped(&rule, &pieces, &meshes, report);
            }
            let inside: Vec<bool> = (0..cells.len() as u32)
                .map(|cell| expr.eval(&|mesh| rule.holds(mesh, cell)))
                .collect();
            select(&pieces, &cells, &inside, progress)?
        };
        let mut rounded = round_off(draft, &soup, tree, reach, params, report, progress)?;
        if params.separate {
            keep_apart(&mut rounded.1, params, report, progress)?;
        }
        let next = coarser.next().filter(|_| !is_sound(&rounded.1, report));
        soup = match next {
            None => {
                let (parents, finished) = rounded;
                return Ok(Surface {
                    soup,
                    parents,
                    finished,
                });
            }
            Some(&Coarser::MergeNear(ulps)) => {
                reach = first_reach.max(2.0 * ulps * ulp);
                report.moved = ulps * ulp;
                merge_near(&soup, ulps * ulp, |_| true, progress)?
            }
            Some(&Coarser::Grid(ulps)) => {
                reach = first_reach.max(2.0 * ulps * ulp);
                report.moved = 1.5 * ulps * ulp;
                coarsened(&inputs.soup(progress)?, ulps * ulp, progress)?
            }
        };
    }
}

/// The triangle of the meshes that each triangle of the result is or lies in.
fn origins(parents: &[Parent], soup: &Soup, inputs: &Inputs) -> Vec<Origin> {
    parents
        .iter()
        .map(|parent| {
            let source = soup.sources[parent.triangle as usize];
            let mesh = &inputs.meshes[source.mesh as usize];
            let turned = inputs.turned[source.mesh as usize].get(source.triangle as usize);
            let own = mesh.triangles().get(source.triangle as usize);
            let is_as_given = own.is_some_and(|t| {
                soup.is_as_given
                    || t.map(|v| mesh.positions()[v as usize]) == soup.corners(parent.triangle)
            });
            Origin {
                mesh: source.mesh,
                triangle: own.map(|_| source.triangle),
                reversed: parent.reversed != (turned == Some(&true)),
                whole: parent.whole && is_as_given,
            }
        })
        .collect()
}

/// Marks triangles that have the corners of the triangle they come from, rounded.
fn mark_whole(
    origins: &mut [Origin],
    mesh: &TriMesh,
    meshes: &[TriMesh],
    coordinates: Coordinates,
) {
    for (t, origin) in (0..).zip(origins) {
        let source = &meshes[origin.mesh as usize];
        origin.whole = origin.triangle.is_some_and(|own| {
            let own = source.corners(own).map(|p| coordinates.nearest(p));
            mesh.corners(t).iter().all(|p| own.contains(p))
        });
    }
}

/// Counts pairs of triangles that meet, in all and within one mesh, unless they were counted before.
fn count_contacts(pieces: &Pieces, report: &mut BooleanReport) {
    if report.intersecting_pairs > 0 {
        return;
    }
    report.intersecting_pairs = pieces.contacts.len() as u64;
    for &(a, b) in &pieces.contacts {
        let [a, b] = [a, b].map(|t| pieces.soup.sources[t as usize].mesh);
        if a == b {
            report.operands[a as usize].self_intersections += 1;
        }
    }
}

/// Rounds, repairs and splits until vertices can hold all sheets apart. Gives the parents of the triangles of the
/// finished mesh, too.
fn round_off(
    mut draft: Draft,
    soup: &Soup,
    tree: CandidateTree,
    reach: f64,
    params: &BooleanParams,
    report: &mut BooleanReport,
    progress: &Progress,
) -> Result<(Vec<Parent>, Finished), BooleanError> {
    let coordinates = params.coordinates;
    report.rounded = round_to(&mut draft, coordinates);
    let mut tree = Some(tree);
    for attempt in 0.. {
        // what follows takes as much memory as the tree, which is seldom needed again
        let around = match tree.take() {
            Some(tree) => tree,
            None => soup.tree(progress)?,
        };
        let repaired = repair(draft, &around, reach, coordinates, progress)?;
        drop(around);
        report.repair_rounds += repaired.rounds;
        report.moved += repaired.moved;
        report.self_intersections = repaired.contacts;
        let (flat, parents) = flattened(repaired.draft, progress)?;
        let mut finished = with_fans(&flat, &parents, soup, progress)?;
        let is_hopeless = repaired.contacts > 0;
        if finished.pinched.is_empty() || is_hopeless || attempt == MAX_SPLITS {
            finished.closed &= finished.pinched.is_empty();
            return Ok((parents, finished));
        }
        let rounded = Draft {
            positions: flat.positions,
            triangles: flat.triangles,
            parents,
        };
        draft = split_edges(rounded, &finished.pinched, coordinates);
    }
    unreachable!("the last attempt returns")
}

/// A draft with one vertex for each fan, and the parents of its triangles.
fn finished(
    draft: Draft,
    soup: &Soup,
    progress: &Progress,
) -> Result<(Vec<Parent>, Finished), Cancelled> {
    let (flat, parents) = flattened(draft, progress)?;
    let finished = with_fans(&flat, &parents, soup, progress)?;
    Ok((parents, finished))
}

/// Gives each fan of triangles a vertex of its own.
fn with_fans(
    flat: &Soup,
    parents: &[Parent],
    soup: &Soup,
    progress: &Progress,
) -> Result<Finished, Cancelled> {
    let pieces = uncut(flat);
    let edges = Edges::of(&pieces, |_| true, progress)?;
    let side = |piece: u32| {
        let parent = parents[piece as usize];
        let mesh = soup.sources[parent.triangle as usize].mesh;
        (mesh, parent.reversed)
    };
    let differ = |one, other| side(one) != side(other);
    finish(&pieces, edges, differ, progress)
}

/// The triangles of a draft that have an area, over one vertex for each place, and their parents.
fn flattened(draft: Draft, progress: &Progress) -> Result<(Soup, Vec<Parent>), Cancelled> {
    let Draft {
        mut positions,
        mut triangles,
        mut parents,
    } = draft;
    for p in &mut positions {
        *p = testable(*p);
    }
    let names = one_for_each_place(&mut positions, progress)?;
    for v in triangles.iter_mut().flatten() {
        *v = names[*v as usize];
    }
    let mut flat = Soup::with_vertices(positions, 1);
    // a triangle that is whole has an area, as in the input
    let mut of_triangle = triangles.iter().zip(&parents);
    if !of_triangle.all(|(&corners, parent)| parent.whole || flat.has_area(corners)) {
        let stays =
            |(&corners, parent): (&[u32; 3], &Parent)| parent.whole || flat.has_area(corners);
        let stays: Vec<bool> = triangles.iter().zip(&parents).map(stays).collect();
        let (mut one, mut other) = (stays.iter(), stays.iter());
        triangles.retain(|_| one.next() == Some(&true));
        parents.retain(|_| other.next() == Some(&true));
    }
    flat.triangles = triangles;
    Ok((flat, parents))
}

/// An expression that can be evaluated.
struct Checked {
    /// The meshes that it speaks of.
    named: Vec<usize>,
    /// The expression with nested operators of one kind as one.
    flattened: Expr,
    /// That without what has no effect on the result.
    pruned: Expr,
}

fn check(meshes: &[TriMesh], expr: &Expr, params: &BooleanParams) -> Result<Checked, BooleanError> {
    let named = expr.meshes();
    if let Some(&mesh) = named.last().filter(|&&mesh| mesh >= meshes.len()) {
        return Err(BooleanError::NoSuchMesh {
            mesh,
            meshes: meshes.len(),
        });
    }
    let bounds: Vec<Aabb> = meshes.iter().map(TriMesh::bounds).collect();
    for (mesh, bounds) in bounds.iter().enumerate() {
        let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
        let in_range = largest == 0.0 || (MIN_EXTENT..=MAX_COORDINATE).contains(&largest);
        if !bounds.is_empty() && !in_range {
            return Err(BooleanError::OutOfRange { mesh, largest });
        }
        if params
            .coordinates
            .nearest(DVec3::splat(largest))
            .is_finite()
        {
            continue;
        }
        if !bounds.is_empty() {
            return Err(BooleanError::BeyondSinglePrecision { mesh, largest });
        }
    }
    let flattened = expr.clone().flattened();
    let mut bounds = bounds;
    if params.close == CloseRule::Base {
        for (bounds, mesh) in bounds.iter_mut().zip(meshes) {
            bounds.min.z = base_level(mesh).min(bounds.min.z);
        }
    }
    let pruned = flattened.pruned(&bounds);
    let triangles = |mesh: usize| meshes[mesh].triangles().len() as u64;
    within_memory(pruned.meshes().into_iter().map(triangles).sum(), 0, params)?;
    Ok(Checked {
        named,
        flattened,
        pruned,
    })
}

/// Returns `true` if this number of triangles, of which this number of pairs meet, can be combined within the memory
/// limit.
fn within_memory(triangles: u64, pairs: u64, params: &BooleanParams) -> Result<(), BooleanError> {
    let needed = triangles * BYTES_PER_TRIANGLE + pairs * BYTES_PER_PAIR;
    match params.memory_bytes {
        Some(allowed) if needed > allowed => Err(BooleanError::OutOfMemory { needed, allowed }),
        _ => Ok(()),
    }
}
