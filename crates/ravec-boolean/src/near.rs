//! Surfaces that lie on one another but for rounding, made to lie on one another.
//!
//! A copy that was turned and turned back is off by some units of the last place everywhere. Both surfaces together are cut
//! into slivers that doubles cannot hold, at every triangle. So vertices that are neighbors become one, and those that
//! nearly lie in an edge or a triangle become vertices of it: exact tests then see that triangles are the same, or share
//! edges. Where many edges of two such surfaces pass each other that is not enough, and vertices are put on a coarse grid.
//!
//! Guarantees: what is closed stays closed, and vertices move no farther along each axis than each function says.
//! Does not guarantee that all distances that remain are larger.

use glam::{DVec3, I64Vec3};
use ravec_mesh::Aabb;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use crate::arrangement::Soup;

/// Distance from an edge or a triangle at which vertices are put into it, as a part of the reach: vertices are farther
/// from each other, so that those in an edge follow one another in a clear order.
const INTO: f64 = 0.5;

/// Vertices or triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 12;

/// Merges vertices that are not farther than `reach` from each other along each axis, and puts vertices into the edges and
/// triangles that are half as far from them: vertices of the triangles that `chosen` names. They move by up to `reach`, and so
/// do points of edges and triangles.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn merge_near(
    soup: &Soup,
    reach: f64,
    chosen: impl Fn(u32) -> bool,
    progress: &Progress,
) -> Result<Soup, Cancelled> {
    let mut is_chosen = vec![false; soup.positions.len()];
    for (t, corners) in soup.triangles.iter().enumerate() {
        if chosen(t as u32) {
            for &v in corners {
                is_chosen[v as usize] = true;
            }
        }
    }
    let (merged, is_chosen) = merge_vertices(soup, reach, &is_chosen, progress)?;
    put_vertices_in(&merged, INTO * reach, &is_chosen, progress)
}

/// Merges vertices that are not farther than `step` from each other along each axis, and rounds them to its multiples: faces
/// that nearly lie on one another come to lie several steps apart, or to cross at clear angles. Vertices move by up to one and
/// a half steps.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn coarsened(soup: &Soup, step: f64, progress: &Progress) -> Result<Soup, Cancelled> {
    let all = vec![true; soup.positions.len()];
    let (mut coarse, _) = merge_vertices(soup, step, &all, progress)?;
    for p in &mut coarse.positions {
        *p = (*p / step).round() * step;
    }
    Ok(coarse)
}

/// Merges chosen vertices. Gives, too, which of those of the result are chosen.
fn merge_vertices(
    soup: &Soup,
    reach: f64,
    is_chosen: &[bool],
    progress: &Progress,
) -> Result<(Soup, Vec<bool>), Cancelled> {
    let cell = |p: DVec3| (p / reach).floor().as_i64vec3();
    let around =
        |c: I64Vec3| (0..27).map(move |i| c + I64Vec3::new(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1));
    let mut in_cell: FxHashMap<I64Vec3, Vec<u32>> = FxHashMap::default();
    let mut positions: Vec<DVec3> = Vec::with_capacity(soup.positions.len());
    let mut stays_chosen = Vec::with_capacity(soup.positions.len());
    let mut names = Vec::with_capacity(soup.positions.len());
    for (at, (&p, &is_chosen)) in soup.positions.iter().zip(is_chosen).enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        let v = positions.len() as u32;
        if is_chosen {
            let distance = |v: u32| (positions[v as usize] - p).abs().max_element();
            let nearest = around(cell(p))
                .filter_map(|c| in_cell.get(&c))
                .flatten()
                .copied()
                .min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            if let Some(v) = nearest.filter(|&v| distance(v) <= reach) {
                names.push(v);
                continue;
            }
            in_cell.entry(cell(p)).or_default().push(v);
        }
        positions.push(p);
        stays_chosen.push(is_chosen);
        names.push(v);
    }
    let mut merged = Soup::with_vertices(positions, soup.meshes);
    for (t, (corners, &source)) in soup.triangles.iter().zip(&soup.sources).enumerate() {
        if t % STRIDE == 0 {
            progress.check()?;
        }
        merged.push(corners.map(|v| names[v as usize]), source);
    }
    Ok((merged, stays_chosen))
}

/// Triangles that are divided.
struct Division<'a> {
    soup: &'a Soup,
    /// Parts, with the triangle that each is of; without corners once it is divided itself.
    parts: Vec<(Option<[u32; 3]>, u32)>,
    /// The parts of each triangle that may be divided.
    of_triangle: FxHashMap<u32, Vec<u32>>,
    /// The parts at each edge.
    at_edge: FxHashMap<[u32; 2], Vec<u32>>,
}

/// Puts chosen vertices that are not farther than `reach` from an edge or a triangle into it, one after the other.
fn put_vertices_in(
    soup: &Soup,
    reach: f64,
    is_chosen: &[bool],
    progress: &Progress,
) -> Result<Soup, Cancelled> {
    let tree = soup.tree(progress)?;
    // for each vertex the triangles that it might be put into: parts of them stay within the reach of their boxes
    let mut near_of: Vec<(u32, Vec<u32>)> = Vec::new();
    for (v, &p) in soup.positions.iter().enumerate() {
        if v % STRIDE == 0 {
            progress.check()?;
        }
        let v = v as u32;
        if is_chosen[v as usize] {
            let around = Aabb {
                min: p - 2.0 * reach,
                max: p + 2.0 * reach,
            };
            let mut near = Vec::new();
            let mut is_near = false;
            tree.for_each_near(&around, |t| {
                if Aabb::around(soup.corners(t)).touches(&around) {
                    near.push(t);
                    is_near |= !soup.triangles[t as usize].contains(&v);
                }
            });
            if is_near {
                near_of.push((v, near));
            }
        }
    }
    let near = near_of.iter().flat_map(|(_, near)| near);
    let mut division = Division::of(soup, near, progress)?;
    for (at, (v, near)) in near_of.iter().enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        division.put_in(*v, near, reach);
    }
    division.finish(progress)
}

impl<'a> Division<'a> {
    /// Triangles none of which is divided yet; only `dividable` ones and their neighbors ever will be.
    fn of<'b>(
        soup: &'a Soup,
        dividable: impl Iterator<Item = &'b u32>,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let mut is_corner = vec![false; soup.positions.len()];
        for (at, &t) in dividable.enumerate() {
            if at % STRIDE == 0 {
                progress.check()?;
            }
            for v in soup.triangles[t as usize] {
                is_corner[v as usize] = true;
            }
        }
        let mut division = Self {
            soup,
            parts: Vec::new(),
            of_triangle: FxHashMap::default(),
            at_edge: FxHashMap::default(),
        };
        for (t, &corners) in soup.triangles.iter().enumerate() {
            if t % STRIDE == 0 {
                progress.check()?;
            }
            if corners.iter().filter(|&&v| is_corner[v as usize]).count() >= 2 {
                division.add(corners, t as u32);
            }
        }
        Ok(division)
    }

    fn add(&mut self, corners: [u32; 3], triangle: u32) {
        // what has a corner twice has vanished, and its other two edges with it
        let [a, b, c] = corners;
        if a == b || b == c || c == a {
            return;
        }
        let name = self.parts.len() as u32;
        self.parts.push((Some(corners), triangle));
        self.of_triangle.entry(triangle).or_default().push(name);
        for edge in edges(corners) {
            self.at_edge.entry(edge).or_default().push(name);
        }
    }

    /// Takes a part out, unless it is out already.
    fn take(&mut self, part: u32) -> Option<([u32; 3], u32)> {
        let (corners, triangle) = &mut self.parts[part as usize];
        let (corners, triangle) = (corners.take()?, *triangle);
        if let Some(list) = self.of_triangle.get_mut(&triangle) {
            list.retain(|&p| p != part);
        }
        for edge in edges(corners) {
            if let Some(list) = self.at_edge.get_mut(&edge) {
                list.retain(|&p| p != part);
            }
        }
        Some((corners, triangle))
    }

    /// Parts of triangles that do not have a vertex yet.
    fn without(&self, v: u32, triangles: &[u32]) -> Vec<(u32, [u32; 3])> {
        let parts = triangles
            .iter()
            .filter_map(|t| self.of_triangle.get(t))
            .flatten();
        parts
            .filter_map(|&part| Some((part, self.parts[part as usize].0?)))
            .filter(|(_, corners)| !corners.contains(&v))
            .collect()
    }

    /// Replaces a part by those between a vertex and the sides at which `ends` are left out.
    fn divide(&mut self, part: u32, v: u32, ends: &[u32]) {
        if let Some((corners, triangle)) = self.take(part) {
            for &end in ends {
                self.add(corners.map(|c| if c == end { v } else { c }), triangle);
            }
        }
    }

    /// Puts a vertex into the edges of parts of some triangles that it is near to, and into those parts. All parts at such an
    /// edge are divided there, so that they still meet.
    fn put_in(&mut self, v: u32, triangles: &[u32], reach: f64) {
        let mut near_edges: Vec<[u32; 2]> = self
            .without(v, triangles)
            .into_iter()
            .flat_map(|(_, corners)| edges(corners))
            .filter(|&edge| self.is_in_edge(v, edge, reach))
            .collect();
        near_edges.sort_unstable();
        near_edges.dedup();
        for edge in near_edges {
            for part in self.at_edge.remove(&edge).unwrap_or_default() {
                self.divide(part, v, &edge);
            }
        }
        for (part, corners) in self.without(v, triangles) {
            if self.is_in_triangle(v, corners, reach) {
                self.divide(part, v, &corners);
            }
        }
    }

    fn is_in_edge(&self, v: u32, edge: [u32; 2], reach: f64) -> bool {
        let [a, b] = edge.map(|v| self.soup.positions[v as usize]);
        let p = self.soup.positions[v as usize] - a;
        let along = b - a;
        let t = p.dot(along) / along.length_squared();
        t > 0.0 && t < 1.0 && (p - t * along).length() <= reach
    }

    fn is_in_triangle(&self, v: u32, corners: [u32; 3], reach: f64) -> bool {
        let [a, b, c] = corners.map(|v| self.soup.positions[v as usize]);
        let p = self.soup.positions[v as usize];
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let is_left = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(normal) > 0.0;
        is_left(a, b) && is_left(b, c) && is_left(c, a) && (p - a).dot(normal).abs() <= reach
    }

    /// All triangles, divided or not, in their order.
    fn finish(self, progress: &Progress) -> Result<Soup, Cancelled> {
        let mut divided = Soup::with_vertices(self.soup.positions.clone(), self.soup.meshes);
        for (t, &corners) in self.soup.triangles.iter().enumerate() {
            if t % STRIDE == 0 {
                progress.check()?;
            }
            let source = self.soup.sources[t];
            match self.of_triangle.get(&(t as u32)) {
                None => divided.push(corners, source),
                Some(parts) => {
                    for corners in parts.iter().filter_map(|&part| self.parts[part as usize].0) {
                        divided.push(corners, source);
                    }
                }
            }
        }
        // freeing the lists takes a while, too
        let lists = self
            .at_edge
            .into_values()
            .chain(self.of_triangle.into_values());
        for (at, list) in lists.enumerate() {
            if at % STRIDE == 0 {
                progress.check()?;
            }
            drop(list);
        }
        Ok(divided)
    }
}

/// The edges of a triangle, lower corner first.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
}

#[cfg(test)]
mod tests;
