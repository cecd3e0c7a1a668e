//! A person who walks in profile, with loose hair: a subject for matting.
//!
//! Coordinates: the ground between the feet is the origin, the height is 1, x is the way ahead, y points down.

use crate::clip::coat::Coat;
use crate::clip::ring::{limb_ring, smooth_ring};
use crate::clip::shape::Part;
use crate::paint::hex;
use crate::random::Seed;
use glam::DVec2;

/// A walking person.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// Duration of two steps.
    pub stride_secs: f64,
    pub coat: u32,
    pub trousers: u32,
    pub hair: u32,
    pub seed: Seed,
}

const HEAD: f64 = 0.066;
/// Loose hairs around the head.
const STRANDS: i64 = 220;

impl Figure {
    /// The parts, the first at the back.
    pub(crate) fn parts(&self, secs: f64) -> Vec<Part> {
        let phase = std::f64::consts::TAU * secs / self.stride_secs;
        let bob = DVec2::new(0.0, 0.006 * (2.0 * phase).cos());
        let (hip, shoulder) = (DVec2::new(0.0, -0.50) + bob, DVec2::new(0.0, -0.785) + bob);
        let mut parts = Vec::new();
        self.arm(shoulder, -phase, 0.62, &mut parts);
        self.leg(hip, phase + std::f64::consts::PI, 0.6, &mut parts);
        self.leg(hip, phase, 1.0, &mut parts);
        self.torso(bob, phase, &mut parts);
        self.head(DVec2::new(0.018, -0.915) + bob, phase, &mut parts);
        self.arm(shoulder, phase + std::f64::consts::PI, 1.0, &mut parts);
        parts
    }

    fn cloth(&self, color: u32, shade: f64, stream: u64) -> Coat {
        Coat::Cloth {
            color: hex(color) * shade as f32,
            light: DVec2::new(2.2, -0.12),
            weave: 0.0035,
            seed: self.seed.fork(stream),
        }
    }

    fn leg(&self, hip: DVec2, phase: f64, shade: f64, parts: &mut Vec<Part>) {
        let swing = 0.42 * phase.sin();
        let bend = 0.55 * (phase - 0.9).cos().max(0.0).powi(2) * 0.9 + 0.06;
        let down = |angle: f64| DVec2::new(angle.sin(), angle.cos());
        let knee = hip + 0.245 * down(swing);
        let ankle = knee + 0.235 * down(swing - bend);
        let toe = ankle + 0.085 * down(swing - bend + 1.45);
        let trousers = || self.cloth(self.trousers, shade, 1);
        let leather = Coat::Flat(hex(0x3a2a20) * shade as f32);
        parts.push(Part::solid(
            limb_ring(ankle + DVec2::new(-0.012, 0.014), toe, [0.021, 0.014]),
            leather,
        ));
        parts.push(Part::solid(
            limb_ring(hip, knee, [0.062, 0.043]),
            trousers(),
        ));
        parts.push(Part::solid(
            limb_ring(knee, ankle, [0.042, 0.029]),
            trousers(),
        ));
    }

    fn arm(&self, shoulder: DVec2, phase: f64, shade: f64, parts: &mut Vec<Part>) {
        let swing = 0.34 * phase.sin();
        let down = |angle: f64| DVec2::new(angle.sin(), angle.cos());
        let elbow = shoulder + 0.155 * down(swing);
        let wrist = elbow + 0.135 * down(swing + 0.32);
        let hand = wrist + 0.034 * down(swing + 0.4);
        let skin = Coat::Flat(hex(0xd9a07c) * shade as f32);
        parts.push(Part::solid(limb_ring(wrist, hand, [0.018, 0.020]), skin));
        let sleeve = || self.cloth(self.coat, 0.93 * shade, 2);
        parts.push(Part::solid(
            limb_ring(shoulder, elbow, [0.044, 0.034]),
            sleeve(),
        ));
        parts.push(Part::solid(
            limb_ring(elbow, wrist, [0.034, 0.026]),
            sleeve(),
        ));
        // the hem of the sleeve
        let cuff = limb_ring(wrist - 0.004 * down(swing), wrist, [0.027, 0.0265]);
        parts.push(Part::solid(cuff, self.cloth(self.coat, 0.7 * shade, 3)).detail());
    }

    fn torso(&self, bob: DVec2, phase: f64, parts: &mut Vec<Part>) {
        let sway = 0.02 * phase.sin();
        let control = [
            (-0.020, -0.865),
            (0.045, -0.845),
            (0.078, -0.77),
            (0.082, -0.68),
            (0.070, -0.60),
            (0.084 + 0.3 * sway, -0.50),
            (0.118 + sway, -0.345),
            (0.02 + sway, -0.330),
            (-0.112 + sway, -0.345),
            (-0.090 + 0.3 * sway, -0.50),
            (-0.068, -0.60),
            (-0.085, -0.70),
            (-0.082, -0.79),
            (-0.058, -0.845),
        ];
        let points: Vec<DVec2> = control.iter().map(|&p| DVec2::from(p) + bob).collect();
        parts.push(Part::solid(
            smooth_ring(&points, 5),
            self.cloth(self.coat, 1.0, 4),
        ));
        // collar, belt, buttons
        let belt = [
            (0.079, -0.605),
            (0.076, -0.580),
            (-0.075, -0.580),
            (-0.074, -0.605),
        ];
        let belt = belt.map(|p| DVec2::from(p) + bob).to_vec();
        parts.push(Part::solid(belt, self.cloth(self.coat, 0.62, 5)).detail());
        for i in 0..3 {
            let at = bob + DVec2::new(0.062 - 0.002 * f64::from(i), -0.775 + 0.062 * f64::from(i));
            let button = limb_ring(at, at, [0.0055, 0.0055]);
            parts.push(Part::flat(button, 0x2a2018).detail());
        }
        let neck = limb_ring(
            DVec2::new(-0.004, -0.835) + bob,
            DVec2::new(0.008, -0.885) + bob,
            [0.036, 0.031],
        );
        parts.push(Part::flat(neck, 0xc88d6a));
        let scarf = [
            (-0.052, -0.872),
            (0.020, -0.858),
            (0.062, -0.866),
            (0.058, -0.838),
            (0.0, -0.822),
            (-0.056, -0.834),
        ];
        let scarf: Vec<DVec2> = scarf.iter().map(|&p| DVec2::from(p) + bob).collect();
        parts.push(Part::solid(
            smooth_ring(&scarf, 5),
            self.cloth(0xd9b24a, 1.0, 6),
        ));
    }

    fn head(&self, center: DVec2, phase: f64, parts: &mut Vec<Part>) {
        let at = |(x, y): (f64, f64)| center + HEAD * DVec2::new(x, y);
        let ring = |points: &[(f64, f64)]| {
            let control: Vec<DVec2> = points.iter().map(|&p| at(p)).collect();
            smooth_ring(&control, 5)
        };
        let hair = hex(self.hair);
        let mass = [
            (0.80, -0.58),
            (0.62, -1.02),
            (0.10, -1.30),
            (-0.62, -1.16),
            (-1.10, -0.55),
            (-1.20, 0.25),
            (-1.16, 1.0),
            (-0.86, 1.35),
            (-0.55, 1.1),
            (-0.42, 0.45),
            (-0.20, 0.0),
            (0.12, -0.35),
            (0.50, -0.50),
        ];
        let inner = |x: f64, y: f64| Coat::Cloth {
            color: hair,
            light: DVec2::new(x, y),
            weave: 0.0012,
            seed: self.seed.fork(7),
        };
        // hair behind the head, the face, hair over it
        self.strands(center, phase, 0..STRANDS / 2, parts);
        let face = [
            (0.10, -1.05),
            (0.66, -0.86),
            (0.86, -0.45),
            (0.84, -0.12),
            (1.10, 0.20),
            (1.04, 0.34),
            (0.86, 0.36),
            (0.94, 0.52),
            (0.86, 0.62),
            (0.90, 0.84),
            (0.70, 1.04),
            (0.35, 0.98),
            (-0.10, 0.85),
            (-0.62, 0.55),
            (-0.9, 0.0),
            (-0.75, -0.7),
        ];
        let skin = Coat::Cloth {
            color: hex(0xe0aa86),
            light: DVec2::new(1.6, -0.8),
            weave: 0.02,
            seed: self.seed.fork(8),
        };
        parts.push(Part::solid(ring(&face), skin));
        let dot = |p: (f64, f64), q: (f64, f64), r: f64, color: u32| {
            Part::flat(limb_ring(at(p), at(q), [HEAD * r; 2]), color).detail()
        };
        parts.push(dot((0.60, -0.06), (0.70, -0.05), 0.055, 0xf4efe8));
        parts.push(dot((0.68, -0.05), (0.69, -0.05), 0.055, 0x2a1c14));
        parts.push(dot((0.48, -0.30), (0.80, -0.32), 0.045, 0x3a2618));
        parts.push(dot((0.66, 0.60), (0.86, 0.57), 0.035, 0x9c4a40));
        parts.push(dot((0.46, 0.42), (0.50, 0.44), 0.13, 0xdd9478).faint(0.35));
        parts.push(Part::solid(ring(&mass), inner(0.8, -3.2)));
        self.strands(center, phase, STRANDS / 2..STRANDS, parts);
    }

    /// Hairs that leave the mass: thin at the tip, falling back and down, swaying with the steps.
    fn strands(
        &self,
        center: DVec2,
        phase: f64,
        range: std::ops::Range<i64>,
        parts: &mut Vec<Part>,
    ) {
        const PIECES: usize = 7;
        for index in range {
            let random =
                |channel, low, high| self.seed.fork(9).between(index, 0, channel, low, high);
            // from the brow over the crown to the nape, clockwise angles against x
            let angle = -(0.9 + 2.9 * random(0, 0.0, 1.0));
            let out = DVec2::from_angle(angle);
            let root = center + HEAD * (DVec2::new(-0.16, 0.0) + random(1, 0.88, 1.05) * out);
            let length = HEAD * random(2, 0.35, 1.15);
            let sway = 0.25 * (phase + random(3, 0.0, 2.5)).sin();
            let start = out.rotate(DVec2::from_angle(random(4, -0.75, 0.35)));
            let fall = DVec2::new(-0.75 + sway, random(5, 0.1, 1.2));
            let width = HEAD * random(6, 0.010, 0.030);
            let path: Vec<DVec2> = (0..=PIECES)
                .map(|i| {
                    let t = i as f64 / PIECES as f64;
                    root + length * (t * start + 0.8 * t * t * fall)
                })
                .collect();
            let mut ring = Vec::with_capacity(2 * PIECES + 1);
            let mut other = Vec::with_capacity(PIECES);
            for (i, pair) in path.windows(2).enumerate() {
                let t = i as f64 / PIECES as f64;
                let aside =
                    (pair[1] - pair[0]).perp().normalize_or_zero() * width * (1.0 - 0.75 * t);
                ring.push(pair[0] + aside);
                other.push(pair[0] - aside);
            }
            ring.push(path[PIECES]);
            ring.extend(other.into_iter().rev());
            let shade = random(7, 0.75, 1.5) as f32;
            parts.push(Part::solid(ring, Coat::Flat(hex(self.hair) * shade)).detail());
        }
    }
}
