//! A line drawing of known strokes: a sailing boat on a choppy sea, hatching, and a line of lettering.
//!
//! Black on warm paper, strokes from hairlines to bold, curves, corners, hatching at
//! two angles and small letters: what vectorisers and edge-aware filters find hard. Coverage as in [`Stroke`].

use crate::glyph;
use crate::paint::{hex, paint};
use crate::random::Seed;
use crate::stroke::{Stroke, Strokes};
use glam::{DVec2, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// Contents of a line drawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LineArtTruth {
    /// All strokes in image coordinates, widths in pixels.
    pub strokes: Vec<Stroke>,
    /// Linear light of ink and of paper.
    pub ink: [f32; 3],
    /// Linear light of the paper, constant.
    pub paper: [f32; 3],
}

/// Draws the boat to fit `size`; the seed moves waves, gulls and hatching.
pub fn line_art(size: Size, seed: Seed) -> (Image<LinearRgb>, LineArtTruth) {
    let truth = LineArtTruth {
        strokes: drawing(size, seed),
        ink: hex(0x171a22).to_array(),
        paper: hex(0xf6f1e4).to_array(),
    };
    (draw(size, &truth), truth)
}

/// A picture of strokes on paper.
pub fn draw(size: Size, truth: &LineArtTruth) -> Image<LinearRgb> {
    let strokes = Strokes::new(truth.strokes.iter().cloned());
    let (ink, paper) = (Vec3::from_array(truth.ink), Vec3::from_array(truth.paper));
    paint(size, |p| paper.lerp(ink, strokes.coverage(p, 1.0) as f32))
}

fn drawing(size: Size, seed: Seed) -> Vec<Stroke> {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let unit = extent.min_element() / 120.0;
    let mut pen = Pen {
        origin: 0.5 * extent - DVec2::splat(60.0 * unit),
        unit,
        strokes: Vec::new(),
    };
    hull(&mut pen);
    sails(&mut pen);
    stays(&mut pen);
    hatching(&mut pen, seed);
    waves(&mut pen, seed);
    sun(&mut pen);
    gulls(&mut pen, seed);
    lettering(&mut pen);
    frame(&mut pen);
    pen.strokes
}

/// Draws on a sheet of 120 × 120 that is centered in the picture.
struct Pen {
    origin: DVec2,
    unit: f64,
    strokes: Vec<Stroke>,
}

impl Pen {
    fn draw(&mut self, points: &[(f64, f64)], smooth: bool, width: f64) {
        let place = |&(x, y): &(f64, f64)| self.origin + self.unit * DVec2::new(x, y);
        let points: Vec<DVec2> = points.iter().map(place).collect();
        self.strokes.push(Stroke {
            points: if smooth {
                glyph::spline(&points)
            } else {
                points
            },
            width: width * self.unit,
        });
    }
}

/// The hull, the deck and the mast.
fn hull(pen: &mut Pen) {
    pen.draw(
        &[
            (28.0, 74.0),
            (34.0, 90.0),
            (44.0, 91.0),
            (78.0, 91.0),
            (90.0, 86.0),
            (97.0, 71.0),
        ],
        true,
        1.1,
    );
    pen.draw(
        &[(28.0, 74.0), (55.0, 79.0), (80.0, 77.0), (97.0, 71.0)],
        true,
        0.9,
    );
    pen.draw(
        &[(31.5, 81.0), (56.0, 84.5), (80.0, 83.0), (94.0, 78.5)],
        true,
        0.4,
    );
    pen.draw(&[(58.0, 78.0), (58.0, 15.0)], false, 1.2);
    pen.draw(
        &[(58.0, 15.0), (58.0, 11.0), (66.0, 12.5), (58.0, 14.5)],
        false,
        0.5,
    );
}

/// The main sail with battens, the fore sail with a seam.
fn sails(pen: &mut Pen) {
    pen.draw(&[(60.0, 18.0), (74.0, 38.0), (87.0, 68.0)], true, 0.9);
    pen.draw(&[(60.0, 18.0), (60.0, 69.0), (87.0, 68.0)], false, 0.9);
    for i in 1..5 {
        let y = 20.0 + 10.0 * f64::from(i);
        pen.draw(
            &[(60.0, y), (60.0 + 5.2 * f64::from(i), y - 0.4)],
            false,
            0.35,
        );
    }
    pen.draw(&[(56.0, 20.0), (46.0, 45.0), (29.0, 70.0)], true, 0.9);
    pen.draw(
        &[(29.0, 70.0), (45.0, 70.5), (56.0, 68.0), (56.0, 20.0)],
        false,
        0.9,
    );
    pen.draw(&[(56.0, 40.0), (41.0, 57.0)], false, 0.3);
}

/// Stays, thinner than a pixel in a small picture.
fn stays(pen: &mut Pen) {
    pen.draw(&[(58.0, 15.0), (25.0, 73.0)], false, 0.22);
    pen.draw(&[(58.0, 15.0), (97.0, 71.0)], false, 0.22);
}

/// Hatching on the shadow sides, at two angles.
fn hatching(pen: &mut Pen, seed: Seed) {
    for i in 0..11 {
        let x = 61.5 + 1.8 * f64::from(i);
        let top = 26.0 + 1.9 * f64::from(i) + seed.between(i64::from(i), 0, 0, 0.0, 2.0);
        pen.draw(&[(x, top + 4.0), (x - 1.0, 66.5)], false, 0.18);
    }
    for i in 0..18 {
        let x = 36.0 + 3.0 * f64::from(i);
        pen.draw(&[(x, 89.5), (x + 4.0, 85.5)], false, 0.25);
    }
}

/// The sea.
fn waves(pen: &mut Pen, seed: Seed) {
    for line in 0..5 {
        let y = 93.0 + 3.0 * f64::from(line);
        let wave: Vec<(f64, f64)> = (0..22)
            .map(|i| {
                let x = 4.0 + 5.4 * f64::from(i);
                let lift = if i % 2 == 0 { -1.6 } else { 1.6 };
                (
                    x,
                    y + lift * seed.between(i64::from(i), i64::from(line), 1, 0.4, 1.0),
                )
            })
            .collect();
        pen.draw(&wave, true, 0.7 - 0.1 * f64::from(line));
    }
}

/// The sun with rays.
fn sun(pen: &mut Pen) {
    let ring: Vec<(f64, f64)> = (0..=36)
        .map(|i| (f64::from(i) * 10.0).to_radians())
        .map(|a| (22.0 + 7.0 * a.cos(), 24.0 + 7.0 * a.sin()))
        .collect();
    pen.draw(&ring, false, 0.8);
    for i in 0..16 {
        let (sin, cos) = (f64::from(i) * 22.5 + 5.0).to_radians().sin_cos();
        let reach = if i % 2 == 0 { 13.5 } else { 11.5 };
        pen.draw(
            &[
                (22.0 + 9.0 * cos, 24.0 + 9.0 * sin),
                (22.0 + reach * cos, 24.0 + reach * sin),
            ],
            false,
            0.5,
        );
    }
}

/// Gulls in the sky.
fn gulls(pen: &mut Pen, seed: Seed) {
    for i in 0..4 {
        let x = seed.between(i, 0, 2, 74.0, 108.0);
        let y = seed.between(i, 0, 3, 10.0, 34.0);
        pen.draw(
            &[
                (x - 4.0, y - 1.0),
                (x - 2.0, y - 2.5),
                (x, y),
                (x + 2.0, y - 2.5),
                (x + 4.0, y - 1.0),
            ],
            true,
            0.45,
        );
    }
}

/// The name on the hull's side, and a caption.
fn lettering(pen: &mut Pen) {
    for (text, x, y, height, width) in [
        ("RAVEC", 68.0, 79.5, 2.6, 0.35),
        ("LINES & CURVES 2 X 3", 22.0, 110.5, 4.6, 0.75),
    ] {
        let scale = height / glyph::HEIGHT;
        for polyline in glyph::polylines(text) {
            let points: Vec<(f64, f64)> = polyline
                .iter()
                .map(|p| (x + scale * p.x, y + scale * p.y))
                .collect();
            pen.draw(&points, false, width);
        }
    }
}

/// A frame: long straight lines all around.
fn frame(pen: &mut Pen) {
    pen.draw(
        &[
            (2.0, 2.0),
            (118.0, 2.0),
            (118.0, 118.0),
            (2.0, 118.0),
            (2.0, 2.0),
        ],
        false,
        0.6,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_on_a_bold_stroke_are_ink_and_far_from_any_are_paper() {
        let size = Size::new(240, 200).unwrap();
        let (picture, truth) = line_art(size, Seed(1));
        let mut seen = [0; 2];
        for row in 0..200 {
            for col in 0..240 {
                let p = crate::paint::center(col, row);
                let free = |s: &Stroke| s.distance(p) - 0.5 * s.width;
                let nearest = truth.strokes.iter().map(free).fold(f64::INFINITY, f64::min);
                // half the diagonal of a pixel away from any border
                if nearest > 0.71 {
                    assert_eq!(picture[(col, row)].0, truth.paper);
                    seen[0] += 1;
                } else if nearest < -0.71 {
                    assert_eq!(picture[(col, row)].0, truth.ink);
                    seen[1] += 1;
                }
            }
        }
        assert!(seen[0] > 10_000 && seen[1] > 50, "{seen:?}");
    }
}
