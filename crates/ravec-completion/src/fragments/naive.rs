//! The plain definitions, and the fast versions held against them.

use super::blocks::{Blocks, Transform};
use super::direct::{Rows, mismatch};
use super::level::{Channels, Level};
use super::minima::Valid;
use super::target::Shape;
use super::template::{TargetPixel, Template};
use fearless_simd::Level as Vectors;
use glam::IVec2;
use proptest::prelude::*;
use ravec_progress::Progress;

/// A scene of inks that may be sources, features, and a target that is known in part.
struct Scene {
    width: i32,
    height: i32,
    inks: Vec<[f32; 4]>,
    features: Vec<f32>,
    sources: Vec<bool>,
    shape: Shape,
    radius: i32,
    target: Vec<([f32; 4], bool, bool)>,
    channels: Channels,
}

fn noise(seed: u64, index: u64) -> f32 {
    let mixed = (index + 1)
        .wrapping_mul(seed | 1)
        .wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
}

impl Scene {
    fn new(seed: u64, size: [i32; 2], radius: i32, square: bool, channels: Channels) -> Self {
        let [width, height] = size;
        let count = (width * height) as u64;
        let ink = |k: u64| {
            let a = if channels.alpha {
                noise(seed, k + 3)
            } else {
                1.0
            };
            [
                noise(seed, k) * a,
                noise(seed, k + 1) * a,
                noise(seed, k + 2) * a,
                a,
            ]
        };
        let side = (2 * radius + 3) as u64;
        Self {
            width,
            height,
            inks: (0..count).map(|k| ink(7 * k)).collect(),
            features: (0..count).map(|k| noise(seed ^ 0x5, k).round()).collect(),
            sources: (0..count)
                .map(|k| noise(seed ^ 0x9, k / 3) > 0.003)
                .collect(),
            shape: if square { Shape::Square } else { Shape::Circle },
            radius,
            target: (0..side * side)
                .map(|k| {
                    (
                        ink(7 * k + 1_000_003),
                        noise(seed ^ 0xb, k / side) > 0.3,
                        k % side > 1,
                    )
                })
                .collect(),
            channels,
        }
    }

    fn level(&self) -> Level {
        Level::new(
            self.width as usize,
            self.height as usize,
            self.channels,
            |col, row| {
                let index = row * self.width as usize + col;
                (
                    self.channels.of(self.inks[index], self.features[index]),
                    self.sources[index],
                )
            },
        )
    }

    fn target_at(&self, step: IVec2) -> ([f32; 4], bool, bool) {
        let side = 2 * self.radius + 3;
        let at = step + self.radius + 1;
        self.target[(at.y * side + at.x) as usize]
    }

    fn template(&self) -> Template {
        Template::new(self.shape, self.radius, self.channels, |step| {
            let (ink, known, inside) = self.target_at(step);
            TargetPixel {
                inside,
                known: known && inside,
                values: self.channels.of(ink, ink[0].round()),
            }
        })
    }

    fn steps(&self) -> impl Iterator<Item = IVec2> {
        let side = 2 * self.radius + 1;
        let all = (0..side * side).map(move |k| IVec2::new(k % side, k / side) - side / 2);
        let (shape, reach) = (self.shape, f64::from(self.radius) + 0.5);
        all.filter(move |step| shape.distance(step.as_dvec2()) <= reach)
    }

    /// Returns `true` if all that a source around a position must cover is there.
    fn valid(&self, middle: IVec2) -> bool {
        self.steps().all(|step| {
            let at = middle + step;
            let there = at.min_element() >= 0 && at.x < self.width && at.y < self.height;
            !self.target_at(step).2 || there && self.sources[(at.y * self.width + at.x) as usize]
        })
    }

    /// The weighted mismatch of a source around a position, in f64 and in plain colors.
    fn mismatch(&self, middle: IVec2) -> f64 {
        let ink = |at: IVec2| {
            let at = at.clamp(IVec2::ZERO, IVec2::new(self.width, self.height) - 1);
            self.inks[(at.y * self.width + at.x) as usize].map(f64::from)
        };
        let known = |step: IVec2| {
            let (_, known, inside) = self.target_at(step);
            known && inside
        };
        let own = |step: IVec2| self.target_at(step).0.map(f64::from);
        // the sum of colors over √3, as the gradients are defined
        let luma = |[r, g, b, _]: [f64; 4]| (r + g + b) / 3f64.sqrt();
        let mut sum = 0.0;
        for step in self.steps().filter(|&step| self.target_at(step).2) {
            let share = self.shape.distance(step.as_dvec2()) / (f64::from(self.radius) + 0.5);
            let weight = ((1.0 - share) / 0.4 + 0.05).min(1.0);
            let at = middle + step;
            if known(step) {
                let (a, b) = (own(step), ink(at));
                let channels = if self.channels.alpha { 4 } else { 3 };
                sum += weight * (0..channels).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>();
                let around = [IVec2::X, IVec2::Y].map(|d| [step - d, step + d]);
                if around.iter().flatten().all(|&s| known(s)) {
                    for ([low, high], d) in around.into_iter().zip([IVec2::X, IVec2::Y]) {
                        let here = luma(own(high)) - luma(own(low));
                        let there = luma(ink(at + d)) - luma(ink(at - d));
                        sum += weight * (0.2 * (here - there)).powi(2);
                    }
                }
            }
            if self.channels.features {
                let here = f64::from(self.target_at(step).0[0].round());
                let there = f64::from(self.features[(at.y * self.width + at.x) as usize]);
                sum += weight * (0.5 * (here - there)).powi(2);
            }
        }
        sum
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn transforms_and_direct_sums_agree_with_the_definition(
        seed in any::<u64>(), width in 40i32..230, height in 40i32..90, radius in 2i32..14, square in any::<bool>(),
        alpha in any::<bool>(), features in any::<bool>(),
    ) {
        let scene = Scene::new(seed, [width, height], radius, square, Channels { alpha, features });
        let (level, template) = (scene.level(), scene.template());
        let transform = Transform::with_longest(template.width);
        let progress = Progress::none();
        for waste in [0.0, 1e9] {
            let blocks = Blocks::new(&level, scene.channels, &transform, waste, &progress).unwrap();
            let query = blocks.query(&template, &transform);
            let mut scratch = transform.scratch();
            let mut valid = Valid::default();
            for block in 0..blocks.count() {
                let first = blocks.first(block);
                let any = valid.find(&template, &level, first, transform.field());
                let field = blocks.field(&level, &query, scene.channels, &transform, &mut scratch, block);
                let mut seen = false;
                for k in (0..transform.field().pow(2)).step_by(7) {
                    let (col, row) = (k % transform.field(), k / transform.field());
                    let corner = first + IVec2::new(col as i32, row as i32);
                    let middle = corner + template.middle;
                    let is_valid = scene.valid(middle);
                    prop_assert_eq!(any && valid.row(row)[col] > 0, is_valid);
                    prop_assert_eq!(template.valid(&level, corner), is_valid);
                    seen |= is_valid;
                    if is_valid && k % 5 == 0 {
                        let truth = scene.mismatch(middle);
                        // what is promised; rounding is about a tenth of it
                        prop_assert!((f64::from(field.row(row)[col]) - truth).abs() <= 1e-3 * truth);
                        let direct = mismatch(Vectors::new(), &template, &level, corner, Rows::All, f32::INFINITY);
                        prop_assert!((f64::from(direct) - truth).abs() <= 1e-5 * truth);
                        let early = mismatch(Vectors::new(), &template, &level, corner, Rows::All, 0.9 * direct);
                        prop_assert!(early == f32::INFINITY);
                    }
                }
                prop_assert!(any || !seen);
            }
        }
    }

    #[test]
    fn runs_longer_than_a_byte_are_told_in_pieces(hole in 0usize..600, from in 1i32..90) {
        let channels = Channels { alpha: false, features: false };
        let level = Level::new(600, 260, channels, |col, _| ([0.0; 5], col != hole));
        let pixel = |_| TargetPixel { inside: true, known: true, values: [0.0; 5] };
        let template = Template::new(Shape::Square, 124, channels, pixel);
        let covered = (from + 1..from + 250).contains(&(hole as i32));
        prop_assert_eq!(template.valid(&level, IVec2::new(from, 2)), !covered);
    }
}
