//! One name for each place, however many ways lead to it.

use glam::DVec3;
use ravec_mesh::Aabb;
use rustc_hash::FxHashMap;

use super::exact::Grid;
use super::point::Point;

/// The size of a cell relative to the extent of everything. Much larger than the widest interval, so that a point falls
/// into one cell or few, and much smaller than the distances of points, so that few share one.
const CELL: f64 = 1e-10;

/// The size of a cell relative to the largest coordinate: some thousand neighboring doubles, for what is far away from
/// the origin.
const MIN_CELL: f64 = 1e-12;

/// All points: those with coordinates first, then those that cuts have made.
pub(crate) struct Places<'a> {
    given: &'a [DVec3],
    pub made: Vec<Point>,
    grid: Grid,
    cell: f64,
    /// For each cell its last entry.
    in_cell: FxHashMap<[i64; 3], u32>,
    /// Names, each with the entry of the same cell before it.
    entries: Vec<(u32, u32)>,
}

/// No entry.
const NONE: u32 = u32::MAX;

impl<'a> Places<'a> {
    pub fn new(given: &'a [DVec3], grid: Grid) -> Self {
        let bounds = Aabb::around(given.iter().copied());
        let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
        Self {
            given,
            made: Vec::new(),
            grid,
            cell: (bounds.diagonal() * CELL).max(farthest * MIN_CELL),
            in_cell: FxHashMap::default(),
            entries: Vec::new(),
        }
    }

    /// The widest interval of a point that still distinguishes it from others at little cost.
    pub fn max_width(&self) -> f64 {
        0.01 * self.cell
    }

    pub fn grid(&self) -> Grid {
        self.grid
    }

    pub fn given(&self) -> &'a [DVec3] {
        self.given
    }

    /// The point that a cut made; `None` for one with coordinates.
    pub fn made(&self, name: u32) -> Option<&Point> {
        self.made
            .get((name as usize).checked_sub(self.given.len())?)
    }

    /// Coordinates, rounded if there are none.
    pub fn rounded(&self, name: u32) -> DVec3 {
        match self.made(name) {
            Some(point) => point.rounded(),
            None => self.given[name as usize],
        }
    }

    /// Makes a point with coordinates known to those that come later.
    pub fn announce(&mut self, name: u32) {
        let point = Point::at(self.given[name as usize]);
        if self.find(&point).is_none() {
            self.enter(&point, name);
        }
    }

    /// The name of the place of a point, which is a new one if nothing was there.
    pub fn name(&mut self, point: Point) -> u32 {
        if let Some(name) = self.find(&point) {
            return name;
        }
        let name = (self.given.len() + self.made.len()) as u32;
        self.enter(&point, name);
        self.made.push(point);
        name
    }

    fn cells(&self, point: &Point) -> impl Iterator<Item = [i64; 3]> + use<> {
        let at = |x: f64| (x / self.cell).floor() as i64;
        let [x, y, z] = point.near.map(|i| at(i.lo)..=at(i.hi));
        x.flat_map(move |i| {
            let z = z.clone();
            y.clone()
                .flat_map(move |j| z.clone().map(move |k| [i, j, k]))
        })
    }

    fn find(&self, point: &Point) -> Option<u32> {
        let is_here = |name: u32| match self.made(name) {
            Some(other) => other.is_same(point, self.grid),
            None => Point::at(self.given[name as usize]).is_same(point, self.grid),
        };
        self.cells(point).find_map(|cell| {
            let mut at = self.in_cell.get(&cell).copied()?;
            while at != NONE {
                let (name, before) = self.entries[at as usize];
                if is_here(name) {
                    return Some(name);
                }
                at = before;
            }
            None
        })
    }

    fn enter(&mut self, point: &Point, name: u32) {
        for cell in self.cells(point) {
            let last = self.in_cell.entry(cell).or_insert(NONE);
            let before = std::mem::replace(last, self.entries.len() as u32);
            self.entries.push((name, before));
        }
    }
}
