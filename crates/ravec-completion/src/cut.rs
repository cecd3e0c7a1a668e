//! Choice of the offset from which each pixel of a hole is copied: one graph cut over all proposals.
//!
//! The plain idea: give each pixel a label, an offset at which there is a source pixel, so that the sum over neighbors with
//! different labels of how much the seam between them shows is least. A seam shows by as much as the two copies differ on
//! both of its sides. Known pixels around the hole take part, with the cost of what the copy would change in them.
//!
//! Source: Pritch, Kav-Venaki and Peleg, "Shift-map image editing", 2009; He and Sun, "Statistics of patch offsets for
//! image completion", 2012; Boykov, Veksler and Zabih, "Fast approximate energy minimization via graph cuts", 2001, for the
//! expansion moves.
//!
//! Guarantees: a pixel that some offset can fill is filled from a source pixel; the same result on any number of threads.
//! Does not guarantee: the least sum of all; expansion finds a labeling that no single label can improve by spreading.
//!
//! Cost: for each label and sweep one largest flow on the pixels that may take it, about half a microsecond a pixel.

use crate::canvas::{HOLE, KNOWN, SOURCE};
use crate::guidance::Guidance;
use crate::max_flow::FlowGraph;
use crate::sheet::{Feature, Sheet, distance_sq, ink_distance_sq};
use glam::IVec2;
use ravec_progress::{Cancelled, Progress};

/// No label.
pub(crate) const UNLABELED: u16 = u16::MAX;
/// Weight of a change of a known pixel at the rim against a seam.
const RIM_WEIGHT: f32 = 4.0;
/// Weight of the pull towards the expected mean against a seam: without it bland sources win; much more, and seams are
/// accepted for it.
const GUIDANCE_WEIGHT: f32 = 0.03;
/// Cost of a seam for each pixel of its length, however little it shows: fewer, larger pieces.
const SEAM_COST: f32 = 0.001;
/// Known pixels around the hole that take part.
const RIM_PX: i32 = 2;
/// Cost of a comparison with an unknown pixel: that of a plainly visible seam.
const UNKNOWN: f32 = 0.3;
/// Costs are whole numbers: a difference of one 8-bit step in one channel is about 15.
const SCALE: f32 = 1e6;
/// More than any seam costs, and less than would overflow.
const IMPOSSIBLE: i32 = 200_000_000;
const NONE: u32 = u32::MAX;

/// The cells that get a label: squares of pixels, as far as these are in the hole or on its rim.
struct Cells {
    side: i32,
    /// Index of the first pixel of each cell, and the number of pixels.
    starts: Vec<u32>,
    pixels: Vec<u32>,
    right: Vec<u32>,
    below: Vec<u32>,
}

impl Cells {
    fn new(sheet: &Sheet, side: i32) -> Self {
        let mut member = vec![false; sheet.states.len()];
        for index in sheet.hole() {
            member[index] = true;
            let at = sheet.position(index);
            for k in 0..(2 * RIM_PX + 1).pow(2) {
                let d = IVec2::new(k % (2 * RIM_PX + 1), k / (2 * RIM_PX + 1)) - RIM_PX;
                if let Some(near) = sheet.index(at + d)
                    && sheet.is(near, KNOWN)
                {
                    member[near] = true;
                }
            }
        }
        let side_px = side as usize;
        let (columns, rows) = (
            sheet.width.div_ceil(side_px),
            sheet.height.div_ceil(side_px),
        );
        let mut number = vec![NONE; columns * rows];
        let (mut starts, mut pixels, mut places) = (vec![0], Vec::new(), Vec::new());
        for (cell, number) in number.iter_mut().enumerate() {
            let (col, row) = (cell % columns * side_px, cell / columns * side_px);
            for y in row..(row + side_px).min(sheet.height) {
                for x in col..(col + side_px).min(sheet.width) {
                    if member[y * sheet.width + x] {
                        pixels.push((y * sheet.width + x) as u32);
                    }
                }
            }
            if pixels.len() as u32 > starts[places.len()] {
                *number = places.len() as u32;
                places.push(cell);
                starts.push(pixels.len() as u32);
            }
        }
        let right = places.iter().map(|&cell| {
            if cell % columns + 1 < columns {
                number[cell + 1]
            } else {
                NONE
            }
        });
        let below = places
            .iter()
            .map(|&cell| number.get(cell + columns).copied().unwrap_or(NONE));
        Self {
            side,
            right: right.collect(),
            below: below.collect(),
            starts,
            pixels,
        }
    }

    fn len(&self) -> usize {
        self.right.len()
    }

    fn pixels(&self, cell: usize) -> &[u32] {
        &self.pixels[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

/// A labeling problem and its costs.
pub(crate) struct Cut<'a> {
    pub(crate) sheet: &'a Sheet,
    pub(crate) offsets: &'a [IVec2],
    pub(crate) guidance: &'a Guidance,
}

fn cost(value: f32) -> i32 {
    (value * SCALE) as i32
}

impl Cut<'_> {
    /// The known pixel at an offset.
    #[inline]
    fn source(&self, pixel: u32, label: u16) -> u32 {
        match self
            .sheet
            .shifted(pixel as usize, self.offsets[usize::from(label)])
        {
            Some(index) if self.sheet.states[index] & KNOWN != 0 => index as u32,
            _ => NONE,
        }
    }

    /// Cost of a label at a pixel, independent of its neighbors.
    fn pixel_cost(&self, pixel: u32, source: u32) -> i32 {
        let (sheet, pixel) = (self.sheet, pixel as usize);
        let usable = source != NONE && sheet.is(source as usize, SOURCE);
        if sheet.is(pixel, HOLE) {
            if !usable {
                return IMPOSSIBLE;
            }
            let (expected, found) = (&self.guidance.expected, &self.guidance.found);
            return cost(
                GUIDANCE_WEIGHT * ink_distance_sq(&expected[pixel], &found[source as usize]),
            );
        }
        let difference = if usable {
            ink_distance_sq(&sheet.inks[pixel], &sheet.inks[source as usize])
        } else {
            UNKNOWN
        };
        cost(RIM_WEIGHT * difference)
    }

    /// Cost of a label at a cell.
    fn cell_cost(&self, pixels: &[u32], label: u16) -> i32 {
        let sum: i64 = pixels
            .iter()
            .map(|&pixel| i64::from(self.pixel_cost(pixel, self.source(pixel, label))))
            .sum();
        sum.min(i64::from(IMPOSSIBLE)) as i32
    }

    /// Difference of two copies of a cell, for each pixel of a seam beside it.
    fn difference(&self, pixels: &[u32], a: u16, b: u16) -> f32 {
        if a == b {
            return 0.0;
        }
        let feature = |index: u32| -> &Feature { &self.sheet.features[index as usize] };
        let mut sum = 0.0;
        for &pixel in pixels {
            let (a, b) = (self.source(pixel, a), self.source(pixel, b));
            sum += if a == NONE || b == NONE {
                UNKNOWN
            } else {
                distance_sq(feature(a), feature(b))
            };
        }
        sum / pixels.len() as f32
    }

    /// Finds labels for all pixels of the hole and its rim.
    ///
    /// `start` are labels to begin with, one for each pixel of the sheet. Cells are squares of `side` pixels. If `near` is
    /// given, only cells at most this many cells away from a seam of the start may change. Labels of pixels that no offset
    /// can fill are [`UNLABELED`], as are those of all other pixels.
    pub(crate) fn assign(
        &self,
        side: i32,
        start: Option<&[u16]>,
        near: Option<i32>,
        sweeps: usize,
        progress: &Progress,
    ) -> Result<Vec<u16>, Cancelled> {
        let mut result = vec![UNLABELED; self.sheet.states.len()];
        if self.offsets.is_empty() {
            return Ok(result);
        }
        let cells = Cells::new(self.sheet, side);
        let count = cells.len();
        let mut state = State {
            labels: vec![0; count],
            costs: vec![0; count],
            fixed: vec![false; count],
        };
        for cell in 0..count {
            if let Some(start) = start {
                let label = start[cells.pixels(cell)[0] as usize];
                state.labels[cell] = if label == UNLABELED { 0 } else { label };
            }
            state.costs[cell] = self.cell_cost(cells.pixels(cell), state.labels[cell]);
        }
        if let Some(near) = near {
            state.fix_interior(&cells, near);
        }
        let mut scratch = Scratch::default();
        let labels = self.offsets.len();
        let phase = progress.phase("cut", (sweeps * labels) as u64);
        // the label after which nothing has changed for a whole round ends the work
        let mut idle = 0;
        for sweep in 0..sweeps {
            for label in 0..labels as u16 {
                phase.advance(1);
                if idle >= labels {
                    continue;
                }
                if sweep > 0 && !state.labels.contains(&label) {
                    // what nobody wanted in the first round is not asked again
                    idle += 1;
                    continue;
                }
                let changed = self.expand(&cells, &mut state, label, &mut scratch, progress)?;
                idle = if changed { 0 } else { idle + 1 };
            }
        }
        for cell in 0..count {
            for &pixel in cells.pixels(cell) {
                let label = state.labels[cell];
                if self.pixel_cost(pixel, self.source(pixel, label)) < IMPOSSIBLE {
                    result[pixel as usize] = label;
                }
            }
        }
        Ok(result)
    }

    /// The costs of the seam between two cells, given by their pixels, labels and the change to the new label: if both keep their
    /// labels, if the second takes the new one, and if the first does.
    fn seam_costs(
        &self,
        [(pixels, la, here), (others, lb, there)]: [(&[u32], u16, f32); 2],
        label: u16,
        length: f32,
    ) -> [i32; 3] {
        let seam = |here: f32, there: f32| cost(length * (here + there + SEAM_COST));
        if la == lb {
            return [0, seam(here, there), seam(here, there)];
        }
        [
            seam(
                self.difference(pixels, la, lb),
                self.difference(others, la, lb),
            ),
            if la == label {
                0
            } else {
                seam(here, self.difference(others, la, label))
            },
            if lb == label {
                0
            } else {
                seam(self.difference(pixels, lb, label), there)
            },
        ]
    }

    /// Lets one label spread where that pays.
    fn expand(
        &self,
        cells: &Cells,
        state: &mut State,
        label: u16,
        scratch: &mut Scratch,
        progress: &Progress,
    ) -> Result<bool, Cancelled> {
        scratch.clear();
        for cell in 0..cells.len() {
            progress.check()?;
            let (pixels, old) = (cells.pixels(cell), state.labels[cell]);
            let mut free = old != label && !state.fixed[cell];
            let cost = if free {
                self.cell_cost(pixels, label)
            } else {
                0
            };
            free &= cost < IMPOSSIBLE;
            scratch.costs.push(cost);
            scratch.change.push(if old == label {
                0.0
            } else {
                self.difference(pixels, old, label)
            });
            scratch.number.push(if free {
                scratch.free.len() as u32
            } else {
                NONE
            });
            if free {
                scratch.free.push(cell as u32);
            }
        }
        if scratch.free.is_empty() {
            return Ok(false);
        }
        let graph = &mut scratch.graph;
        graph.reset(scratch.free.len());
        for (number, &cell) in scratch.free.iter().enumerate() {
            graph.add_terminals(
                number as u32,
                scratch.costs[cell as usize],
                state.costs[cell as usize],
            );
        }
        let length = cells.side as f32;
        for cell in 0..cells.len() {
            progress.check()?;
            for other in [cells.right[cell], cells.below[cell]] {
                if other == NONE {
                    continue;
                }
                let other = other as usize;
                let (a, b) = (scratch.number[cell], scratch.number[other]);
                if a == NONE && b == NONE {
                    continue;
                }
                let ends = [cell, other]
                    .map(|cell| (cells.pixels(cell), state.labels[cell], scratch.change[cell]));
                let [kept, second, first] = self.seam_costs(ends, label, length);
                match (a, b) {
                    // a neighbor that stays as it is has the new label already if that costs nothing
                    (a, NONE) => graph.add_terminals(a, first, kept),
                    (NONE, b) => graph.add_terminals(b, second, kept),
                    (a, b) => {
                        // squares need not obey the triangle inequality; where they do not, staying counts as less
                        let kept = kept.min(first + second);
                        // E(a, b) = kept + (first − kept)·a − first·b + (second + first − kept)·(1 − a)·b
                        graph.add_terminals(a, first - kept, 0);
                        graph.add_terminals(b, 0, first);
                        graph.add_edge(a, b, second + first - kept, 0);
                    }
                }
            }
        }
        graph.solve(|| progress.is_cancelled());
        progress.check()?;
        let mut changed = false;
        for (number, &cell) in scratch.free.iter().enumerate() {
            if graph.on_sink_side(number as u32) {
                let cell = cell as usize;
                state.labels[cell] = label;
                state.costs[cell] = scratch.costs[cell];
                changed = true;
            }
        }
        Ok(changed)
    }
}

/// A labeling of cells.
struct State {
    labels: Vec<u16>,
    costs: Vec<i32>,
    fixed: Vec<bool>,
}

impl State {
    /// Fixes the cells that are farther than `near` steps from a seam and have a possible label.
    fn fix_interior(&mut self, cells: &Cells, near: i32) {
        let mut open: Vec<bool> = self.costs.iter().map(|&cost| cost >= IMPOSSIBLE).collect();
        for cell in 0..cells.len() {
            for other in [cells.right[cell], cells.below[cell]] {
                if other != NONE && self.labels[cell] != self.labels[other as usize] {
                    open[cell] = true;
                    open[other as usize] = true;
                }
            }
        }
        for _ in 1..near {
            let before = open.clone();
            for cell in 0..cells.len() {
                for other in [cells.right[cell], cells.below[cell]] {
                    if other != NONE {
                        open[cell] |= before[other as usize];
                        open[other as usize] |= before[cell];
                    }
                }
            }
        }
        self.fixed = open.into_iter().map(|open| !open).collect();
    }
}

/// Memory that is used again for each label.
#[derive(Default)]
struct Scratch {
    graph: FlowGraph,
    costs: Vec<i32>,
    change: Vec<f32>,
    number: Vec<u32>,
    free: Vec<u32>,
}

impl Scratch {
    fn clear(&mut self) {
        self.costs.clear();
        self.change.clear();
        self.number.clear();
        self.free.clear();
    }
}
