//! Weights of point pairs for a model when the noise level is unknown.
//!
//! A threshold asks for the noise's σ. Here σ is anything up to a maximum, all equally likely, and the weight of a residual
//! is its mean over them: it falls smoothly from the middle to nothing at k · s. The loss is the integral that makes
//! iterated weighted least squares with these weights minimize it.
//!
//! Notation: r, residual with two degrees of freedom; s, the largest σ; x = r² / 2s²; k² = 9.21, the quantile of χ² with two degrees of
//! freedom at 99 %; weight ∝ Γ(½, x) − Γ(½, k²/2); loss ∝ ∫ weight · r dr.
//!
//! Source: Barath, Noskova, Ivashechkin and Matas, "MAGSAC++, a fast, reliable and accurate robust estimator", 2020. We
//! differ in the degrees of freedom: theirs are four, ours two, since a first-order distance leaves only the two that are
//! normal to the manifold of perfect pairs.

use std::sync::LazyLock;

/// The quantile of χ² with two degrees of freedom at 99 %, −2 ln 0.01.
pub(crate) const K_SQ: f64 = 9.210_340_371_976_182;

/// Entries between r² = 0 and r² = (k s)². With 512 the interpolated weight is wrong by less than 1.5 % of the whole
/// next to 0, where it falls like a root, and by less than 1e-4 from a twentieth of the range on.
const ENTRIES: usize = 512;

struct Tables {
    /// From 1 at r = 0 to 0 at k s.
    weight: [f64; ENTRIES + 1],
    /// 1 − loss / greatest loss: from 1 to 0.
    gain: [f64; ENTRIES + 1],
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let root = |j: usize| (0.5 * K_SQ * j as f64 / ENTRIES as f64).sqrt();
    // with t = √x, Γ(½, x) − Γ(½, k²/2) = 2 ∫ e^(−t²) dt from √x to k/√2
    let simpson = |f: &dyn Fn(f64) -> f64, a: f64, b: f64| {
        (b - a) / 6.0 * (f(a) + 4.0 * f(0.5 * (a + b)) + f(b))
    };
    let bell = |t: f64| 2.0 * (-t * t).exp();
    let mut weight = [0.0; ENTRIES + 1];
    for j in (0..ENTRIES).rev() {
        weight[j] = weight[j + 1] + simpson(&bell, root(j), root(j + 1));
    }
    // by parts, ∫ weight dx = x · weight + ∫ √x e^(−x) dx, the latter with t = √x again
    let rest = |t: f64| 2.0 * t * t * (-t * t).exp();
    let mut loss = [0.0; ENTRIES + 1];
    let mut tail = 0.0;
    for j in 1..=ENTRIES {
        tail += simpson(&rest, root(j - 1), root(j));
        loss[j] = root(j).powi(2) * weight[j] + tail;
    }
    Tables {
        gain: loss.map(|l| 1.0 - l / loss[ENTRIES]),
        weight: weight.map(|w| w / weight[0]),
    }
});

/// The weight and the gain for one s.
#[derive(Clone, Copy)]
pub(crate) struct Kernel {
    tables: &'static Tables,
    entries_per_px_sq: f64,
}

impl Kernel {
    /// For a largest σ above 0, in pixels.
    pub(crate) fn new(max_sigma_px: f64) -> Self {
        Self {
            tables: &TABLES,
            entries_per_px_sq: ENTRIES as f64 / (K_SQ * max_sigma_px * max_sigma_px),
        }
    }

    /// The squared residual from which on a pair says nothing.
    pub(crate) fn cutoff_sq(&self) -> f64 {
        ENTRIES as f64 / self.entries_per_px_sq
    }

    /// Weight of a squared residual in weighted least squares: 1 at 0, 0 beyond the cutoff and for NaN.
    pub(crate) fn weight(&self, residual_sq: f64) -> f64 {
        self.interpolate(&self.tables.weight, residual_sq)
    }

    /// Evidence of a squared residual for the model: 1 at 0, 0 beyond the cutoff and for NaN.
    #[inline]
    pub(crate) fn gain(&self, residual_sq: f64) -> f64 {
        self.interpolate(&self.tables.gain, residual_sq)
    }

    #[inline(always)]
    fn interpolate(&self, table: &[f64; ENTRIES + 1], residual_sq: f64) -> f64 {
        let at = residual_sq * self.entries_per_px_sq;
        if at < ENTRIES as f64 {
            let entry = at as usize;
            let t = at - entry as f64;
            table[entry] + t * (table[entry + 1] - table[entry])
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_and_gain_fall_from_one_to_nothing() {
        let kernel = Kernel::new(2.0);
        assert_eq!((kernel.weight(0.0), kernel.gain(0.0)), (1.0, 1.0));
        let (mut weight, mut gain) = (1.0, 1.0);
        for step in 1..=200 {
            let r = kernel.cutoff_sq().sqrt() * f64::from(step) / 200.0;
            assert!(kernel.weight(r * r) < weight && kernel.gain(r * r) < gain || step == 200);
            (weight, gain) = (kernel.weight(r * r), kernel.gain(r * r));
        }
        assert!(weight < 1e-9 && gain < 1e-9);
        for none in [kernel.cutoff_sq() * 1.01, f64::INFINITY, f64::NAN] {
            assert_eq!((kernel.weight(none), kernel.gain(none)), (0.0, 0.0));
        }
    }

    #[test]
    fn the_weight_is_the_mean_over_all_noise_levels() {
        // the definition: the density of the residual under each σ, where the pair would be an inlier
        let mean = |r: f64, max_sigma: f64| {
            let steps = 200_000;
            let sum: f64 = (0..steps)
                .map(|i| max_sigma * (f64::from(i) + 0.5) / f64::from(steps))
                .filter(|sigma| r * r < K_SQ * sigma * sigma)
                .map(|sigma| (-0.5 * r * r / (sigma * sigma)).exp() / (sigma * sigma))
                .sum();
            sum * max_sigma / f64::from(steps)
        };
        // substituting s = r² / 2σ² makes of the mean Γ(½, x) − Γ(½, k²/2), up to a factor 1/r
        // the interpolated root next to 0 is good to 1.5 %
        let kernel = Kernel::new(3.0);
        let ratio = |r: f64| r * mean(r, 3.0) / kernel.weight(r * r);
        for r in [0.5, 1.0, 2.0, 4.0, 7.0] {
            assert!(
                (ratio(r) / ratio(3.0) - 1.0).abs() < 1.5e-2,
                "{r}: {}",
                ratio(r)
            );
        }
    }

    #[test]
    fn the_slope_of_the_gain_is_the_weight() {
        let kernel = Kernel::new(1.5);
        let slope = |s: f64| (kernel.gain(s - 0.05) - kernel.gain(s + 0.05)) / 0.1;
        for s in [2.0, 5.0, 10.0, 15.0] {
            let ratio = slope(s) / kernel.weight(s) / (slope(1.0) / kernel.weight(1.0));
            assert!((ratio - 1.0).abs() < 1e-2, "{s}: {ratio}");
        }
    }
}
