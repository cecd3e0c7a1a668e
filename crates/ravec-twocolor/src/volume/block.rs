//! The voxels of one block, and the exact score of a plane.
//!
//! The best colors of a split are the means of its sides, so its *gain* over one color is, on colors whose mean over
//! the block is 0, `|S|² (1/w + 1/(W − w))` with the sum `S` and the weight `w` of one side. A row of voxels along an axis
//! is cut by a plane at one place, so prefix sums along the rows turn the sum over a side into one look-up a row.
//!
//! Notation: `n` voxels, `k` of them below, `S` their sum (colors times alpha, mean-free, then alpha, mean-free).
//! Positions here are indices `[x, y, t]` from 0. *Below* is where the coordinate along the plane's leading axis is
//! smaller than the plane's height.
//!
//! Cost: a score takes one look-up a row, N·M or N² of them; preparing a block three additions a voxel.

use ravec_raster::Oklab;

/// A plane as a height along one axis over the two others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heights {
    /// The leading axis: 0, 1 or 2.
    pub axis: usize,
    /// The height over the middle of the block.
    pub center: f64,
    /// Slope of the height along each of the two other coordinates, in order.
    pub slopes: [f64; 2],
}

/// The two axes besides each.
pub(super) const OTHERS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

impl Heights {
    /// The plane `normal·p = offset` in indices, in a block with the given middle; nothing if the normal is 0 or not a
    /// number.
    pub fn of_plane(normal: [f64; 3], offset: f64, middle: [f64; 3]) -> Option<Self> {
        let mut axis = 0;
        for other in 1..3 {
            if normal[other].abs() > normal[axis].abs() {
                axis = other;
            }
        }
        let leading = normal[axis];
        if leading.is_nan() || leading.abs() <= 1e-12 {
            return None;
        }
        let [b, c] = OTHERS[axis];
        Some(Self {
            axis,
            center: (offset - normal[b] * middle[b] - normal[c] * middle[c]) / leading,
            slopes: [-normal[b] / leading, -normal[c] / leading],
        })
    }

    /// The unit normal, pointing away from what is below, and the offset in indices.
    pub fn plane(&self, middle: [f64; 3]) -> ([f64; 3], f64) {
        let [b, c] = OTHERS[self.axis];
        let [sb, sc] = self.slopes;
        let scale = 1.0 / (1.0 + sb * sb + sc * sc).sqrt();
        let mut normal = [0.0; 3];
        normal[self.axis] = scale;
        normal[b] = -sb * scale;
        normal[c] = -sc * scale;
        (
            normal,
            (self.center - sb * middle[b] - sc * middle[c]) * scale,
        )
    }
}

/// The primitive integer directions up to sign with components up to `fineness`: 13 for 1, 49 for 2.
pub(super) fn directions(fineness: i32) -> impl Iterator<Item = [i32; 3]> {
    let range = move || -fineness..=fineness;
    range()
        .flat_map(move |t| range().flat_map(move |y| range().map(move |x| [x, y, t])))
        .filter(|u| {
            let leading = u.iter().rev().find(|&&v| v != 0);
            let is_double = u.iter().all(|v| v % 2 == 0);
            leading.is_some_and(|&v| v > 0) && !is_double
        })
}

/// Up to this many voxels the finer set of directions is used. Small blocks have few rows, so that the coarse set leaves
/// large gaps between the splits that it meets, and the finer set costs little: without it, 2 of the 1350 splits of
/// 3 × 3 × 3 voxels are missed when they are planted.
const SMALL_VOXELS: usize = 128;

/// One voxel: alpha times mean-free Oklab, and mean-free alpha. Four floats add in one instruction.
pub(super) type Voxel = [f32; 4];

/// Adds `sign · voxel`.
#[inline(always)]
pub(super) fn add(sum: &mut Voxel, sign: f32, voxel: &Voxel) {
    for (s, &v) in sum.iter_mut().zip(voxel) {
        *s += sign * v;
    }
}

/// The prefix sums of all rows along one axis.
#[derive(Debug, Default)]
pub(super) struct Chart {
    /// For each row, over the second and then the first of the other axes, the sums of its first 0, 1, … voxels.
    prefixes: Vec<Voxel>,
}

/// The voxels of one block. Memory is kept from block to block.
#[derive(Debug, Default)]
pub(super) struct Block {
    /// Columns, rows and frames, each at least 1.
    pub extents: [usize; 3],
    /// By x, then y, then t.
    pub voxels: Vec<Voxel>,
    charts: [Chart; 3],
    /// By `k` the factor `1/k + 1/(n − k)`; 0 where a side is empty.
    factors: Vec<f32>,
    opaque: bool,
    mean: [f64; 3],
    mean_alpha: f64,
    weight: f64,
    /// The squared error of one color.
    pub energy: f64,
}

/// Weights below this count as nothing: less than half a step of 16-bit alpha.
const NO_WEIGHT: f64 = 1.0 / 131_072.0;

fn inverse(weight: f64) -> f64 {
    if weight > NO_WEIGHT {
        1.0 / weight
    } else {
        0.0
    }
}

/// The two sides of a split, with their best colors.
pub(super) struct Sides {
    pub gain: f64,
    /// Of what is below, and of the rest.
    pub colors: [Oklab; 2],
    pub alphas: [f32; 2],
}

impl Block {
    /// Takes the block's voxels, by x, then y, then t: Oklab (straight) and alpha.
    pub fn load(&mut self, extents: [usize; 3], voxels: impl Iterator<Item = ([f32; 3], f32)>) {
        self.extents = extents;
        let count = self.count();
        self.voxels.clear();
        self.voxels
            .extend(voxels.map(|([l, a, b], alpha)| [l, a, b, alpha]));
        debug_assert_eq!(self.voxels.len(), count);

        let mut sums = [0.0; 4];
        for voxel in &self.voxels {
            let alpha = f64::from(voxel[3]);
            for (sum, &value) in sums.iter_mut().zip(&voxel[..3]) {
                *sum += alpha * f64::from(value);
            }
            sums[3] += alpha;
        }
        self.opaque = self.voxels.iter().all(|voxel| voxel[3] == 1.0);
        self.weight = sums[3];
        self.mean_alpha = sums[3] / count as f64;
        self.mean = std::array::from_fn(|c| sums[c] * inverse(sums[3]));

        let mean: Voxel = std::array::from_fn(|c| {
            if c < 3 {
                self.mean[c] as f32
            } else {
                self.mean_alpha as f32
            }
        });
        let (mut color_energy, mut alpha_energy) = (0.0f64, 0.0f64);
        for voxel in &mut self.voxels {
            let alpha = voxel[3];
            let off: Voxel = std::array::from_fn(|c| voxel[c] - mean[c]);
            let squared = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
            color_energy += f64::from(alpha * squared);
            alpha_energy += f64::from(off[3] * off[3]);
            *voxel = [alpha * off[0], alpha * off[1], alpha * off[2], off[3]];
        }
        self.energy = color_energy + alpha_energy;
    }

    /// Prepares scores. Blocks that turn out flat never need it.
    pub fn prepare(&mut self) {
        let count = self.count();
        if self.factors.len() != count + 1 {
            let factor = |k: usize| {
                if k.is_multiple_of(count) {
                    0.0
                } else {
                    1.0 / k as f32 + 1.0 / (count - k) as f32
                }
            };
            self.factors = (0..=count).map(factor).collect();
        }
        let strides = self.strides();
        for (axis, chart) in self.charts.iter_mut().enumerate() {
            let [b, c] = OTHERS[axis];
            chart.prefixes.clear();
            for at_c in 0..self.extents[c] {
                for at_b in 0..self.extents[b] {
                    let first = at_b * strides[b] + at_c * strides[c];
                    let mut sum = [0.0; 4];
                    chart.prefixes.push(sum);
                    for k in 0..self.extents[axis] {
                        add(&mut sum, 1.0, &self.voxels[first + k * strides[axis]]);
                        chart.prefixes.push(sum);
                    }
                }
            }
        }
    }

    /// Voxels in the block.
    pub fn count(&self) -> usize {
        self.extents.iter().product()
    }

    /// Fineness of the [`directions`] to try.
    pub fn fineness(&self) -> i32 {
        if self.count() <= SMALL_VOXELS { 2 } else { 1 }
    }

    /// Strides between neighbors along each axis.
    pub fn strides(&self) -> [usize; 3] {
        [1, self.extents[0], self.extents[0] * self.extents[1]]
    }

    /// The index position halfway between the first and the last voxel.
    pub fn middle(&self) -> [f64; 3] {
        self.extents.map(|extent| 0.5 * (extent as f64 - 1.0))
    }

    /// Energy that remains from rounding alone: below this, splits cannot be distinguished.
    pub fn rounding(&self) -> f64 {
        3e-6 * self.energy
    }

    /// The gain of a split from the number and the sum of the voxels below.
    #[inline(always)]
    pub fn gain(&self, below: usize, sum: &Voxel) -> f32 {
        let color = sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2];
        let factor = self.factors[below];
        if self.opaque {
            return color * factor;
        }
        let weight = below as f64 * self.mean_alpha + f64::from(sum[3]);
        let color_factor = (inverse(weight) + inverse(self.weight - weight)) as f32;
        // with nothing on one side the factor of the count is 0, but rounding may leave a weight
        if factor == 0.0 {
            0.0
        } else {
            color * color_factor + sum[3] * sum[3] * factor
        }
    }

    /// The sum over the first `cut` voxels of a row.
    #[inline(always)]
    pub fn prefix(&self, axis: usize, row: usize, cut: usize) -> &Voxel {
        &self.charts[axis].prefixes[row * (self.extents[axis] + 1) + cut]
    }

    /// Number of voxels of a row of `extent` that lie below a height.
    #[inline(always)]
    pub fn cut(height: f64, extent: usize) -> usize {
        // the conversion saturates: negative heights and NaN give 0
        (height.ceil() as usize).min(extent)
    }

    /// Calls `f(row, height, b, c)` for each row along the plane's leading axis; `b` and `c` count from the middle.
    #[inline(always)]
    pub fn for_each_row(&self, plane: &Heights, mut f: impl FnMut(usize, f64, f64, f64)) {
        let [b, c] = OTHERS[plane.axis];
        let middle = self.middle();
        let mut row = 0;
        for at_c in 0..self.extents[c] {
            let from_c = at_c as f64 - middle[c];
            let base = plane.center + plane.slopes[1] * from_c;
            for at_b in 0..self.extents[b] {
                let from_b = at_b as f64 - middle[b];
                f(row, base + plane.slopes[0] * from_b, from_b, from_c);
                row += 1;
            }
        }
    }

    /// The gain of the split that a plane makes.
    pub fn score(&self, plane: &Heights) -> f32 {
        let extent = self.extents[plane.axis];
        let (mut sum, mut below) = ([0.0; 4], 0);
        self.for_each_row(plane, |row, height, _, _| {
            let cut = Self::cut(height, extent);
            add(&mut sum, 1.0, self.prefix(plane.axis, row, cut));
            below += cut;
        });
        self.gain(below, &sum)
    }

    /// The color and alpha of the whole block.
    pub fn one_color(&self) -> (Oklab, f32) {
        (Oklab(self.mean.map(|v| v as f32)), self.mean_alpha as f32)
    }

    /// The sides of a split, added up in double precision. `is_below` gets indices.
    pub fn sides(&self, is_below: impl Fn([usize; 3]) -> bool) -> Sides {
        let mut sum = [0.0f64; 4];
        let mut below = 0usize;
        let mut voxels = self.voxels.iter();
        for t in 0..self.extents[2] {
            for y in 0..self.extents[1] {
                for (x, voxel) in voxels.by_ref().take(self.extents[0]).enumerate() {
                    if is_below([x, y, t]) {
                        below += 1;
                        for (s, &v) in sum.iter_mut().zip(voxel) {
                            *s += f64::from(v);
                        }
                    }
                }
            }
        }
        let counts = [below, self.count() - below].map(|k| k as f64);
        let weight_0 = counts[0] * self.mean_alpha + sum[3];
        let weights = [weight_0, self.weight - weight_0];
        let color_sq = sum[..3].iter().map(|s| s * s).sum::<f64>();
        let gain = color_sq * (inverse(weights[0]) + inverse(weights[1]))
            + sum[3] * sum[3] * (inverse(counts[0]) + inverse(counts[1]));
        let side = |index: usize| {
            let sign = if index == 0 { 1.0 } else { -1.0 };
            // a side without weight is invisible; it takes the mean color
            let scale = sign * inverse(weights[index]);
            Oklab(std::array::from_fn(|c| {
                (self.mean[c] + sum[c] * scale) as f32
            }))
        };
        Sides {
            gain,
            colors: [side(0), side(1)],
            alphas: std::array::from_fn(|i| {
                (weights[i] * inverse(counts[i])).clamp(0.0, 1.0) as f32
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_primitive_and_listed_once() {
        assert_eq!(directions(1).count(), 13);
        let all: Vec<_> = directions(2).collect();
        assert_eq!(all.len(), 49);
        for (i, u) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|v| v != u && v.map(|c| -c) != *u));
        }
    }
}
