//! Planes to start the search from.

use super::block::{Block, Heights, add, directions};
use super::search::Scored;
use crate::line::Line;
use glam::DVec2;

/// A line found in one frame of the block, or in the mean of all.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trace {
    /// In indices: `line.normal · [x, y] = line.offset_px`.
    pub line: Line,
    /// The frame, as an index.
    pub frame: f64,
    /// Weight of the line among others: its squared contrast.
    pub weight: f64,
}

/// Collects planes, best first, without near repetitions.
#[derive(Debug, Default)]
pub(super) struct Starts {
    found: Vec<Scored>,
    bins: Vec<([f32; 4], usize)>,
}

impl Starts {
    /// Scores all starts of a block and returns up to `most` of them, the best first.
    ///
    /// `still` is the line of the mean frame.
    pub fn collect(
        &mut self,
        block: &Block,
        traces: &[Trace],
        still: Option<Line>,
        most: usize,
    ) -> &[Scored] {
        self.found.clear();
        for line in traces.iter().map(|trace| trace.line).chain(still) {
            self.try_plane(block, line.normal, 0.0, line.offset_px);
        }
        for (i, first) in traces.iter().enumerate() {
            for second in &traces[i + 1..] {
                self.try_moving(block, &[*first, *second]);
            }
        }
        if traces.len() > 2 {
            self.try_moving(block, traces);
        }
        self.try_directions(block);

        // stable: of equal ones the first stays first
        self.found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut kept = 0;
        for i in 0..self.found.len() {
            let start = self.found[i];
            if kept < most && !self.found[..kept].iter().any(|other| alike(other, &start)) {
                self.found[kept] = start;
                kept += 1;
            }
        }
        &self.found[..kept]
    }

    /// The plane `normal·[x, y] + normal_t·t = offset`.
    fn try_plane(&mut self, block: &Block, normal: DVec2, normal_t: f64, offset: f64) {
        let normal = [normal.x, normal.y, normal_t];
        if let Some(plane) = Heights::of_plane(normal, offset, block.middle()) {
            let gain = block.score(&plane);
            self.found.push(Scored { plane, gain });
        }
    }

    /// The plane whose traces are nearest to the given lines: their mean direction, moving steadily.
    fn try_moving(&mut self, block: &Block, traces: &[Trace]) {
        // a line has no sign, so directions are averaged at twice their angle
        let mut doubled = DVec2::ZERO;
        for trace in traces {
            let n = trace.line.normal;
            doubled += trace.weight * DVec2::new(n.x * n.x - n.y * n.y, 2.0 * n.x * n.y);
        }
        let normal = DVec2::from_angle(0.5 * doubled.to_angle());
        let middle = DVec2::new(block.middle()[0], block.middle()[1]);
        // weighted regression of the offset on the frame, at the point of each line nearest to the middle of the block
        let (mut w, mut wt, mut wd, mut wtt, mut wtd) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for trace in traces {
            let foot = middle - trace.line.signed_distance(middle) * trace.line.normal;
            let (t, d) = (trace.frame, normal.dot(foot));
            w += trace.weight;
            wt += trace.weight * t;
            wd += trace.weight * d;
            wtt += trace.weight * t * t;
            wtd += trace.weight * t * d;
        }
        let determinant = w * wtt - wt * wt;
        // also false for NaN
        if determinant > 1e-12 * w * wtt {
            let velocity = (w * wtd - wt * wd) / determinant;
            let offset = (wd - velocity * wt) / w;
            self.try_plane(block, normal, -velocity, offset);
        }
    }

    /// The best plane along each of the [`directions`]: the projections of voxels are integers,
    /// so one pass sorts them and all offsets are scored.
    fn try_directions(&mut self, block: &Block) {
        for u in directions(block.fineness()) {
            let [ux, uy, ut] = u;
            let [w, h, m] = block.extents.map(|extent| extent as i32 - 1);
            let least = (ux * w).min(0) + (uy * h).min(0) + (ut * m).min(0);
            let most = (ux * w).max(0) + (uy * h).max(0) + (ut * m).max(0);
            self.bins.clear();
            self.bins.resize((most - least + 1) as usize, ([0.0; 4], 0));
            let mut voxels = block.voxels.iter();
            for t in 0..=m {
                for y in 0..=h {
                    let row = uy * y + ut * t - least;
                    for (x, voxel) in (0..=w).zip(&mut voxels) {
                        let (sum, count) = &mut self.bins[(row + ux * x) as usize];
                        add(sum, 1.0, voxel);
                        *count += 1;
                    }
                }
            }
            let (mut sum, mut below) = ([0.0; 4], 0);
            let mut best = (0.0f32, 0);
            for (bin, (part, count)) in self.bins.iter().enumerate() {
                add(&mut sum, 1.0, part);
                below += count;
                let gain = block.gain(below, &sum);
                if gain > best.0 {
                    best = (gain, bin as i32);
                }
            }
            let offset = f64::from(best.1 + least) + 0.5;
            if let Some(plane) = Heights::of_plane(u.map(f64::from), offset, block.middle()) {
                self.found.push(Scored {
                    plane,
                    gain: best.0,
                });
            }
        }
    }
}

/// Returns `true` if two starts are so near that the search would take both to the same plane.
fn alike(a: &Scored, b: &Scored) -> bool {
    let near = |x: f64, y: f64, by: f64| (x - y).abs() < by;
    a.gain == b.gain
        || (a.plane.axis == b.plane.axis
            && near(a.plane.center, b.plane.center, 0.5)
            && near(a.plane.slopes[0], b.plane.slopes[0], 0.1)
            && near(a.plane.slopes[1], b.plane.slopes[1], 0.1))
}
