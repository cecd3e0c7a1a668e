//! Cuts all triangles along all others.
//!
//! 1. Pairs of triangles whose boxes touch are asked how they meet.
//! 2. The points of these contacts get names, one for each place.
//! 3. Triangles that overlap within a plane are put together; each such group, and each other triangle that meets
//!    anything, is triangulated with its points and segments.
//! 4. The pieces are put together again over common names.
//!
//! Source: Cherchi, Livesu, Scateni and Attene, "Fast and robust mesh arrangements using floating-point arithmetic", 2020.
//! We differ in what lies in one plane: overlapping triangles are triangulated together, so that each piece of the plane
//! is there once and knows all triangles that cover it.
//!
//! Guarantees: pieces meet in whole edges and corners only; together they cover exactly what the triangles cover.
//! Cost: near that of finding the pairs if few triangles meet; n log n in the points within one plane.

use glam::DVec3;
use ravec_mesh::{Aabb, Bvh, Sign, orient2d, orient3d};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::contact::{Contact, Crossing, contact, flat, view};
use super::exact::Grid;
use super::places::Places;
use super::point::{Definition, Point};
use super::soup::Soup;
use super::triangulation::{Held, Line, Triangulation};

/// How far beyond a group of triangles the corners of the triangle around it are, in sizes of the group. Anything that
/// keeps them clear of the group will do.
const AROUND: f64 = 8.0;

/// Triangles of the soup that cover a piece.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Cover {
    /// One, turned the same way.
    One(u32),
    /// Several within a plane, and whether each is turned the same way.
    Several(Box<[(u32, bool)]>),
}

impl Cover {
    /// The triangles, and whether each is turned as the piece is.
    pub fn iter(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let (one, several): (Option<(u32, bool)>, &[(u32, bool)]) = match self {
            Self::One(triangle) => (Some((*triangle, true)), &[]),
            Self::Several(list) => (None, list),
        };
        one.into_iter().chain(several.iter().copied())
    }
}

/// A part of the surface of the soup that nothing crosses.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    /// Names of its corners.
    pub corners: [u32; 3],
    pub cover: Cover,
}

/// A soup in pieces.
pub(crate) struct Pieces<'a> {
    pub soup: &'a Soup,
    pub places: Places<'a>,
    pub pieces: Vec<Piece>,
    /// For each triangle its pieces, among them pieces of others in its plane if there are any.
    pub of_triangle: Vec<[u32; 2]>,
    /// Pairs of triangles that met in more than corners and an edge.
    pub contacts: Vec<(u32, u32)>,
}

/// What a triangle meets.
#[derive(Default)]
struct Cuts {
    /// Points, and the edge that each is known to be on.
    points: Vec<(u32, Option<[u32; 2]>)>,
    /// Segments, and the triangles that they are shared with.
    segments: Vec<([u32; 2], u32)>,
}

/// Triangles in one plane, one as a rule, and everything that cuts them.
struct Group {
    members: Vec<u32>,
    cuts: Cuts,
}

/// A corner of a piece.
enum Corner {
    Named(u32),
    Made(Box<Point>),
}

/// A group in pieces: corners by index among the points.
struct CutGroup {
    points: Vec<Corner>,
    pieces: Vec<([u32; 3], Cover)>,
}

/// Cuts a soup. With `only`, triangles for which it is false are known to meet none of each other.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn cut<'a>(
    soup: &'a Soup,
    bvh: &Bvh,
    only: Option<&[bool]>,
    progress: &Progress,
) -> Result<Pieces<'a>, Cancelled> {
    let contacts = contacts(soup, bvh, only, progress)?;
    let mut places = Places::new(&soup.positions, Grid::holding(&soup.positions));
    let names = name_crossings(soup, &contacts, &mut places);
    let groups = gather(soup, &contacts, &names);
    progress.check()?;

    let phase = progress.phase("cutting", groups.len() as u64);
    let cut: Vec<CutGroup> = groups
        .par_iter()
        .map(|group| {
            progress.check()?;
            let cut = cut_group(soup, &places, group);
            phase.advance(1);
            Ok(cut)
        })
        .collect::<Result<_, Cancelled>>()?;

    let mut is_cut = vec![false; soup.triangles.len()];
    for &member in groups.iter().flat_map(|g| &g.members) {
        is_cut[member as usize] = true;
    }
    let mut pieces = Vec::with_capacity(soup.triangles.len());
    let mut of_triangle = vec![[0; 2]; soup.triangles.len()];
    for (triangle, &corners) in soup.triangles.iter().enumerate() {
        if !is_cut[triangle] {
            let at = pieces.len() as u32;
            of_triangle[triangle] = [at, at + 1];
            pieces.push(Piece {
                corners,
                cover: Cover::One(triangle as u32),
            });
        }
    }
    for (group, cut) in groups.iter().zip(cut) {
        let names: Vec<u32> = cut
            .points
            .into_iter()
            .map(|corner| match corner {
                Corner::Named(name) => name,
                Corner::Made(point) => places.name(*point),
            })
            .collect();
        let first = pieces.len() as u32;
        pieces.extend(cut.pieces.into_iter().map(|(corners, cover)| Piece {
            corners: corners.map(|c| names[c as usize]),
            cover,
        }));
        for &member in &group.members {
            of_triangle[member as usize] = [first, pieces.len() as u32];
        }
    }
    Ok(Pieces {
        soup,
        places,
        pieces,
        of_triangle,
        contacts: contacts.into_iter().map(|(a, b, _)| (a, b)).collect(),
    })
}

/// A soup of which nothing is cut.
pub(crate) fn uncut(soup: &Soup) -> Pieces<'_> {
    let piece = |(triangle, &corners): (usize, &[u32; 3])| Piece {
        corners,
        cover: Cover::One(triangle as u32),
    };
    Pieces {
        soup,
        places: Places::new(&soup.positions, Grid::holding(&soup.positions)),
        pieces: soup.triangles.iter().enumerate().map(piece).collect(),
        of_triangle: (0..soup.triangles.len() as u32)
            .map(|t| [t, t + 1])
            .collect(),
        contacts: Vec::new(),
    }
}

/// All pairs of triangles that meet in more than corners and an edge, ascending.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn contacts(
    soup: &Soup,
    bvh: &Bvh,
    only: Option<&[bool]>,
    progress: &Progress,
) -> Result<Vec<(u32, u32, Contact)>, Cancelled> {
    let mut contacts = bvh.filter_overlapping_pairs(progress, |a, b| {
        let asked = only.is_none_or(|only| only[a as usize] || only[b as usize]);
        let found = asked.then(|| contact(soup, a, b)).flatten();
        found.map(|contact| (a, b, contact))
    })?;
    contacts.par_sort_unstable_by_key(|&(a, b, _)| (a, b));
    Ok(contacts)
}

/// Gives each crossing the name of its place.
fn name_crossings(
    soup: &Soup,
    contacts: &[(u32, u32, Contact)],
    places: &mut Places,
) -> FxHashMap<Crossing, u32> {
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
    let (grid, most_width) = (places.grid(), places.most_width());
    let made: Vec<Option<Point>> = crossings
        .par_iter()
        .map(|&(crossing, between)| {
            let definition = define(soup, crossing, between)?;
            Some(Point::defined(definition, most_width, grid))
        })
        .collect();
    let mut names = FxHashMap::default();
    names.reserve(crossings.len());
    // vertices sort first, so that a place where there is one gets its name
    for ((crossing, _), point) in crossings.into_iter().zip(made) {
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
    names
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

/// Puts triangles that overlap in a plane together, with all that cuts them.
fn gather(
    soup: &Soup,
    contacts: &[(u32, u32, Contact)],
    names: &FxHashMap<Crossing, u32>,
) -> Vec<Group> {
    let mut parent: FxHashMap<u32, u32> = FxHashMap::default();
    fn root(parent: &FxHashMap<u32, u32>, mut t: u32) -> u32 {
        while let Some(&p) = parent.get(&t) {
            if p == t {
                break;
            }
            t = p;
        }
        t
    }
    for &(a, b, contact) in contacts {
        for t in [a, b] {
            parent.entry(t).or_insert(t);
        }
        if contact == Contact::Coplanar {
            let (a, b) = (root(&parent, a), root(&parent, b));
            // the lower is the root, and paths are kept short
            parent.insert(a.max(b), a.min(b));
        }
    }
    let mut touched: Vec<u32> = parent.keys().copied().collect();
    touched.sort_unstable();
    let mut groups: Vec<Group> = Vec::new();
    let mut group_of: FxHashMap<u32, usize> = FxHashMap::default();
    for &t in &touched {
        let root = root(&parent, t);
        parent.insert(t, root);
        let at = *group_of.entry(root).or_insert_with(|| {
            groups.push(Group {
                members: Vec::new(),
                cuts: Cuts::default(),
            });
            groups.len() - 1
        });
        groups[at].members.push(t);
    }
    for &(a, b, contact) in contacts {
        for (t, other) in [(a, b), (b, a)] {
            let cuts = &mut groups[group_of[&parent[&t]]].cuts;
            let corners = &soup.triangles[t as usize];
            match contact {
                Contact::Coplanar => {}
                Contact::Point(point) => {
                    cuts.points.push((names[&point], edge_with(corners, point)));
                }
                Contact::Segment(one, end) => {
                    cuts.points.push((names[&one], edge_with(corners, one)));
                    cuts.points.push((names[&end], edge_with(corners, end)));
                    cuts.segments.push(([names[&one], names[&end]], other));
                }
            }
        }
    }
    for group in &mut groups {
        // with an edge first, where one is known
        let points = &mut group.cuts.points;
        points.sort_unstable_by_key(|&(name, edge)| (name, edge.is_none(), edge));
        points.dedup_by_key(|&mut (name, _)| name);
    }
    groups
}

/// The edge of a triangle that a crossing is on by its name.
fn edge_with(corners: &[u32; 3], crossing: Crossing) -> Option<[u32; 2]> {
    let edges = match crossing {
        Crossing::Vertex(_) => [None, None],
        Crossing::EdgeTriangle(edge, _) => [Some(edge), None],
        Crossing::Edges(one, other) => [Some(one), Some(other)],
    };
    let is_own = |edge: &[u32; 2]| edge.iter().all(|v| corners.contains(v));
    edges.into_iter().flatten().find(is_own)
}

/// Triangulates a group.
fn cut_group<'a>(soup: &Soup, places: &'a Places<'_>, group: &Group) -> CutGroup {
    let first = group.members[0];
    let plane = soup.corners(first);
    let axis = view(plane);
    let alone = group.members.len() == 1;
    let grid = places.grid();
    let held = |name: u32| match places.made(name) {
        Some(point) => Held::Shared(point),
        None => Held::Own(Point::at(places.given()[name as usize])),
    };
    let turned = |t: u32| {
        let [a, b, c] = soup.corners(t).map(|p| flat(p, axis));
        orient2d(a, b, c) == Sign::Negative
    };
    let mut corner_names = soup.triangles[first as usize];
    if turned(first) {
        corner_names.swap(1, 2);
    }
    let start = if alone {
        corner_names.map(held)
    } else {
        let corners = group.members.iter().flat_map(|&t| soup.corners(t));
        around(&Aabb::around(corners), axis, grid).map(|p| Held::Own(Point::at(p)))
    };
    let mut names: Vec<Option<u32>> = vec![None; 3];
    let mut triangulation = Triangulation::new(start, plane, axis, grid, places.most_width());
    let mut vertex_of: FxHashMap<u32, u32> = FxHashMap::default();
    // the borders of a triangle alone, as chains of vertices
    let mut chains = [[0, 1], [1, 2], [2, 0]].map(Vec::from);
    let mut insert_at = |triangulation: &mut Triangulation<'a>, name: u32, chain: Option<usize>| {
        *vertex_of.entry(name).or_insert_with(|| {
            let (vertex, is_new) = match chain {
                Some(chain) => triangulation.insert_on(&mut chains[chain], held(name)),
                None => triangulation.insert(held(name)),
            };
            if is_new {
                names.push(Some(name));
            } else if names[vertex as usize].is_none_or(|other| name < other) {
                names[vertex as usize] = Some(name);
            }
            vertex
        })
    };
    for &t in &group.members {
        for v in soup.triangles[t as usize] {
            insert_at(&mut triangulation, v, None);
        }
    }
    // those on borders first, while borders have no other vertices
    let (on_edges, others): (Vec<_>, Vec<_>) = group
        .cuts
        .points
        .iter()
        .map(|&(point, edge)| (point, edge.filter(|_| alone)))
        .partition(|(_, edge)| edge.is_some());
    for (point, edge) in on_edges.into_iter().chain(others) {
        let chain = edge.map(|[a, b]| {
            let [a, b] = [a, b].map(|v| corner_names.iter().position(|&c| c == v));
            // the chain from corner k to the next one
            match (a, b) {
                (Some(0), Some(1)) | (Some(1), Some(0)) => 0,
                (Some(1), Some(2)) | (Some(2), Some(1)) => 1,
                _ => 2,
            }
        });
        insert_at(&mut triangulation, point, chain);
    }
    let mut insert =
        |triangulation: &mut Triangulation<'a>, name| insert_at(triangulation, name, None);
    // the borders of a triangle alone are those of the piece
    let mut borders = Vec::new();
    for &t in group.members.iter().filter(|_| !alone) {
        let mut corners = soup.triangles[t as usize];
        if turned(t) {
            corners.swap(1, 2);
        }
        let [a, b, c] = corners.map(|v| insert(&mut triangulation, v));
        let places = corners.map(|v| soup.positions[v as usize]);
        let border: [u32; 3] = std::array::from_fn(|i| {
            let (from, to) = ([a, b, c][i], [b, c, a][i]);
            let line = Line::Edge([places[i], places[(i + 1) % 3]]);
            triangulation.insert_segment(from, to, line)
        });
        borders.push((t, [a, b], border));
    }
    for &([from, to], other) in &group.cuts.segments {
        let (from, to) = (
            insert(&mut triangulation, from),
            insert(&mut triangulation, to),
        );
        triangulation.insert_segment(from, to, Line::Plane(soup.corners(other)));
    }
    triangulation.make_round();
    let mut pieces = Vec::new();
    if alone {
        let flip = turned(first);
        pieces.extend(triangulation.triangles().map(|[a, b, c]| {
            let corners = if flip { [a, c, b] } else { [a, b, c] };
            (corners, Cover::One(first))
        }));
    } else {
        let mut covers: Vec<Vec<(u32, bool)>> = vec![Vec::new(); triangulation.triangles().count()];
        for (t, [a, b], border) in borders {
            for piece in triangulation.enclosed(a, b, &border) {
                covers[piece as usize].push((t, !turned(t)));
            }
        }
        for (corners, cover) in triangulation.triangles().zip(covers) {
            match cover[..] {
                [] => {}
                [(t, true)] => pieces.push((corners, Cover::One(t))),
                [(t, false)] => {
                    let [a, b, c] = corners;
                    pieces.push(([a, c, b], Cover::One(t)));
                }
                _ => pieces.push((corners, Cover::Several(cover.into()))),
            }
        }
    }
    let made = names.len();
    let points = (0..triangulation.point_count())
        .map(|vertex| {
            let name = names
                .get(vertex)
                .copied()
                .flatten()
                .filter(|_| vertex < made);
            match name {
                Some(name) => Corner::Named(name),
                None => Corner::Made(Box::new(triangulation.point(vertex as u32).clone())),
            }
        })
        .collect();
    CutGroup { points, pieces }
}

/// The corners of a triangle around everything in a box, counter-clockwise as seen against `axis`.
fn around(bounds: &Aabb, axis: usize, grid: Grid) -> [DVec3; 3] {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let (center, size) = (bounds.center(), bounds.size());
    let reach = AROUND * size[i].max(size[j]);
    [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]].map(|[x, y]| {
        let mut p = DVec3::ZERO;
        p[i] = grid.snap(center[i] + x * reach);
        p[j] = grid.snap(center[j] + y * reach);
        p
    })
}
