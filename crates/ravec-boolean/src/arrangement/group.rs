//! Triangles that share a plane, and what cuts them.

use glam::DVec3;
use ravec_mesh::{Aabb, Sign, orient2d};
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use super::contact::{Contact, Crossing, flat, view};
use super::crossings::edge_with;
use super::cut::Cover;
use super::exact::Grid;
use super::places::Places;
use super::point::Point;
use super::soup::Soup;
use super::triangulation::{Line, PointRef, Triangulation};

/// Distance of the corners of the enclosing triangle from a group of triangles, in sizes of the group. Anything that
/// keeps them clear of the group will do.
const AROUND: f64 = 8.0;

/// Triangles that overlap in one plane, one as a rule, and everything that cuts them.
#[derive(Default)]
pub(crate) struct Group {
    pub members: Vec<u32>,
    /// Points, and the edge that each is known to be on.
    points: Vec<(u32, Option<[u32; 2]>)>,
    /// Segments, and the triangles in whose planes they lie, too.
    segments: Vec<([u32; 2], u32)>,
}

/// A corner of a piece.
pub(crate) enum Corner {
    /// A point that has a name.
    Named(u32),
    /// A new one.
    Made(Box<Point>),
}

/// A group in pieces: corners by index among the points.
pub(crate) struct CutGroup {
    pub points: Vec<Corner>,
    pub pieces: Vec<([u32; 3], Cover)>,
}

/// Contacts between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 14;

/// Puts triangles that overlap in a plane together, with all that cuts them.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn gather(
    soup: &Soup,
    contacts: &[(u32, u32, Contact)],
    names: &FxHashMap<Crossing, u32>,
    progress: &Progress,
) -> Result<Vec<Group>, Cancelled> {
    let mut planes = DisjointSets::new(soup.triangles.len());
    let mut touched = Vec::with_capacity(2 * contacts.len());
    for &(a, b, contact) in contacts {
        touched.extend([a, b]);
        if contact == Contact::Coplanar {
            planes.join(a, b);
        }
    }
    progress.check()?;
    touched.sort_unstable();
    touched.dedup();
    progress.check()?;
    let mut groups: Vec<Group> = Vec::new();
    let mut group_of: FxHashMap<u32, usize> = FxHashMap::default();
    for t in touched {
        let at = *group_of.entry(planes.root(t)).or_insert_with(|| {
            groups.push(Group::default());
            groups.len() - 1
        });
        groups[at].members.push(t);
    }
    for (at, &(a, b, contact)) in contacts.iter().enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        let (ends, is_segment) = match contact {
            Contact::Coplanar => continue,
            Contact::Point(point) => ([point; 2], false),
            Contact::Segment(one, end) => ([one, end], true),
        };
        let names = ends.map(|end| names[&end]);
        let named = ends
            .into_iter()
            .zip(names)
            .take(1 + usize::from(is_segment));
        for (t, other) in [(a, b), (b, a)] {
            let group = &mut groups[group_of[&planes.root(t)]];
            let corners = &soup.triangles[t as usize];
            let points = named.clone();
            group
                .points
                .extend(points.map(|(end, name)| (name, edge_with(corners, end))));
            if is_segment {
                group.segments.push((names, other));
            }
        }
    }
    for (at, Group { points, .. }) in groups.iter_mut().enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        // with an edge first, where one is known
        points.sort_unstable_by_key(|&(name, edge)| (name, edge.is_none(), edge));
        points.dedup_by_key(|&mut (name, _)| name);
    }
    Ok(groups)
}

/// Returns `true` if a triangle runs clockwise as seen against `axis`.
fn is_turned(soup: &Soup, triangle: u32, axis: usize) -> bool {
    let [a, b, c] = soup.corners(triangle).map(|p| flat(p, axis));
    orient2d(a, b, c) == Sign::Negative
}

/// The corners of a triangle, counter-clockwise as seen against `axis`.
fn upright(soup: &Soup, triangle: u32, axis: usize) -> [u32; 3] {
    let [a, b, c] = soup.triangles[triangle as usize];
    if is_turned(soup, triangle, axis) {
        [a, c, b]
    } else {
        [a, b, c]
    }
}

/// A triangulation over points with names.
struct Drawing<'a> {
    triangulation: Triangulation<'a>,
    places: &'a Places<'a>,
    /// The names of vertices. Vertices beyond have been made by crossings.
    names: Vec<Option<u32>>,
    vertex_of: FxHashMap<u32, u32>,
}

impl<'a> Drawing<'a> {
    fn point_ref(places: &'a Places<'a>, name: u32) -> PointRef<'a> {
        match places.made(name) {
            Some(point) => PointRef::Shared(point),
            None => PointRef::Own(Box::new(Point::at(places.given()[name as usize]))),
        }
    }

    /// The vertex at a point, on a border if it is known to be on one.
    fn vertex(&mut self, name: u32, border: Option<&mut Vec<u32>>) -> u32 {
        if let Some(&vertex) = self.vertex_of.get(&name) {
            return vertex;
        }
        let point = Self::point_ref(self.places, name);
        let (vertex, is_new) = match border {
            Some(border) => self.triangulation.insert_on(border, point),
            None => self.triangulation.insert(point),
        };
        if is_new {
            self.names.push(Some(name));
        } else if self.names[vertex as usize].is_none_or(|other| name < other) {
            self.names[vertex as usize] = Some(name);
        }
        self.vertex_of.insert(name, vertex);
        vertex
    }

    fn into_points(self) -> Vec<Corner> {
        (0..self.triangulation.point_count())
            .map(|vertex| match self.names.get(vertex).copied().flatten() {
                Some(name) => Corner::Named(name),
                None => Corner::Made(Box::new(self.triangulation.point(vertex as u32).clone())),
            })
            .collect()
    }
}

/// Triangulates a group.
pub(crate) fn cut_group<'a>(soup: &Soup, places: &'a Places<'a>, group: &Group) -> CutGroup {
    let first = group.members[0];
    let plane = soup.corners(first);
    let axis = view(plane);
    if let [only] = group.members[..] {
        cut_one(soup, places, group, only, (plane, axis))
    } else {
        cut_several(soup, places, group, (plane, axis))
    }
}

/// A triangle that shares its plane with none that it meets: its borders are those of the triangulation.
fn cut_one<'a>(
    soup: &Soup,
    places: &'a Places<'a>,
    group: &Group,
    triangle: u32,
    (plane, axis): ([DVec3; 3], usize),
) -> CutGroup {
    let corners = upright(soup, triangle, axis);
    let start = corners.map(|name| Drawing::point_ref(places, name));
    let mut drawing = Drawing {
        triangulation: Triangulation::new(start, plane, axis, places.grid(), places.max_width()),
        places,
        names: corners.map(Some).into(),
        vertex_of: corners.into_iter().zip(0..).collect(),
    };
    // from each corner to the next
    let mut borders = [[0, 1], [1, 2], [2, 0]].map(Vec::from);
    // points on borders first, while borders have no other vertices
    for &(point, edge) in group.points.iter().filter(|(_, edge)| edge.is_some()) {
        let border = (0..3).find(|&i| {
            let ends = [corners[i], corners[(i + 1) % 3]];
            edge.is_some_and(|edge| edge.iter().all(|v| ends.contains(v)))
        });
        drawing.vertex(point, border.map(|i| &mut borders[i]));
    }
    let others = group.points.iter().map(|&(name, _)| name).collect();
    for name in in_rows(others, places, axis) {
        drawing.vertex(name, None);
    }
    draw_segments(soup, &mut drawing, group);
    let turned = is_turned(soup, triangle, axis);
    let pieces = drawing
        .triangulation
        .triangles()
        .map(|[a, b, c]| {
            let corners = if turned { [a, c, b] } else { [a, b, c] };
            (corners, Cover::One(triangle))
        })
        .collect();
    CutGroup {
        points: drawing.into_points(),
        pieces,
    }
}

fn draw_segments(soup: &Soup, drawing: &mut Drawing, group: &Group) {
    for &(ends, other) in &group.segments {
        let [from, to] = ends.map(|name| drawing.vertex(name, None));
        let line = Line::Plane(soup.corners(other));
        drawing.triangulation.insert_segment(from, to, line);
    }
    drawing.triangulation.make_round();
}

/// Triangles that overlap: all of them in one triangulation, within a triangle around them.
fn cut_several<'a>(
    soup: &Soup,
    places: &'a Places<'a>,
    group: &Group,
    (plane, axis): ([DVec3; 3], usize),
) -> CutGroup {
    let grid = places.grid();
    let all = group.members.iter().flat_map(|&t| soup.corners(t));
    let start =
        around(&Aabb::around(all), axis, grid).map(|p| PointRef::Own(Box::new(Point::at(p))));
    let mut drawing = Drawing {
        triangulation: Triangulation::new(start, plane, axis, grid, places.max_width()),
        places,
        names: vec![None; 3],
        vertex_of: FxHashMap::default(),
    };
    let corners = group
        .members
        .iter()
        .flat_map(|&t| soup.triangles[t as usize]);
    let points = group.points.iter().map(|&(name, _)| name);
    for name in in_rows(corners.chain(points).collect(), places, axis) {
        drawing.vertex(name, None);
    }
    let mut borders = Vec::with_capacity(group.members.len());
    for &t in &group.members {
        let names = upright(soup, t, axis);
        let ends = names.map(|name| soup.positions[name as usize]);
        let corners = names.map(|name| drawing.vertex(name, None));
        let border: [u32; 3] = std::array::from_fn(|i| {
            let next = (i + 1) % 3;
            let line = Line::Edge([ends[i], ends[next]]);
            drawing
                .triangulation
                .insert_segment(corners[i], corners[next], line)
        });
        borders.push((t, [corners[0], corners[1]], border));
    }
    draw_segments(soup, &mut drawing, group);
    let mut covers: Vec<Vec<(u32, bool)>> =
        vec![Vec::new(); drawing.triangulation.triangles().count()];
    for (t, [a, b], border) in borders {
        let with = !is_turned(soup, t, axis);
        for piece in drawing.triangulation.enclosed(a, b, &border) {
            covers[piece as usize].push((t, with));
        }
    }
    let mut pieces = Vec::new();
    for (corners, cover) in drawing.triangulation.triangles().zip(covers) {
        let [a, b, c] = corners;
        match cover[..] {
            [] => {}
            [(t, true)] => pieces.push((corners, Cover::One(t))),
            [(t, false)] => pieces.push(([a, c, b], Cover::One(t))),
            _ => pieces.push((corners, Cover::Several(cover.into()))),
        }
    }
    CutGroup {
        points: drawing.into_points(),
        pieces,
    }
}

/// Points in rows, one there and the next back, so that each is near the one before and soon found.
fn in_rows(mut names: Vec<u32>, places: &Places, axis: usize) -> Vec<u32> {
    names.sort_unstable();
    names.dedup();
    let at = |name: u32| flat(places.rounded(name), axis);
    let rows = (names.len() as f64).sqrt().ceil();
    let (low, high) = names.iter().map(|&name| at(name).y).fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(low, high): (f64, f64), y| (low.min(y), high.max(y)),
    );
    let per_unit = rows / (high - low).max(f64::MIN_POSITIVE);
    let mut keyed: Vec<(i64, f64, u32)> = names
        .into_iter()
        .map(|name| {
            let p = at(name);
            let row = ((p.y - low) * per_unit) as i64;
            (row, if row % 2 == 0 { p.x } else { -p.x }, name)
        })
        .collect();
    keyed.sort_unstable_by(|a, b| {
        let places = a.0.cmp(&b.0).then(a.1.total_cmp(&b.1));
        places.then(a.2.cmp(&b.2))
    });
    keyed.into_iter().map(|(_, _, name)| name).collect()
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
