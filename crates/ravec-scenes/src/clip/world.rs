//! The background of a shot: a plane with a large picture on it, painted once and filmed through homographies.
//!
//! Painting a detailed scene takes microseconds a pixel, so the plane is painted once, finer than any frame shows it, and a
//! frame takes its pixels from that picture. Lines and discs of known place are painted with exact coverage of its texels.
//!
//! A frame's pixel is the mean of four samples, at the middles of its quarters; each is interpolated linearly between
//! texels, on the two levels of a pyramid whose texels are next in size to a quarter. Interpolation between texels keeps
//! the first moment of what is painted, so that an edge lies where its formula says.
//!
//! Guarantees: the same bytes on any number of threads. Non-guarantees: beyond the border of the picture its last texels
//! are repeated; where the plane is foreshortened more than about 1:3, fine texture aliases a little.

use crate::clip::camera::project;
use crate::clip::ring::{cover, disc_ring};
use crate::clip::shape::{Disc, disc_in_frame, ring_in_frame};
use crate::paint::paint_adaptive;
use glam::{DMat3, DVec2, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// A long straight line on the plane.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Its name, the same in all frames.
    pub name: String,
    /// One end of its middle line.
    pub from: DVec2,
    /// The other end.
    pub to: DVec2,
    /// Its full width at `from`, in pixels.
    pub width_px: f64,
}

/// A disc on the plane, or its image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Its name, the same in all frames.
    pub name: String,
    /// Center and radius, where the image of the disc is a disc.
    pub disc: Option<Disc>,
    /// Points on its border, in order.
    pub outline: Vec<DVec2>,
}

/// A rectangle on the plane, or its image: a window, a poster.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quad {
    /// Its name, the same in all frames.
    pub name: String,
    /// Its corners: upper left, upper right, lower right, lower left, as seen on the plane.
    pub corners: [DVec2; 4],
}

/// Things of known place on the background, in world or in frame pixels.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Features {
    /// Straight lines.
    pub lines: Vec<Line>,
    /// Discs.
    pub discs: Vec<Round>,
    /// Rectangles.
    pub quads: Vec<Quad>,
}

/// Points of an outline of a disc.
const OUTLINE_POINTS: usize = 64;

impl Features {
    /// The features in a frame. What lies behind the camera, even in part, is left out; what lies outside the frame is not.
    pub fn in_frame(&self, frame_from_world: &DMat3) -> Self {
        let m = frame_from_world;
        let line = |line: &Line| {
            let along = (line.to - line.from).normalize_or_zero();
            let side = 0.5 * line.width_px * along.perp();
            let edge = |sign: f64| project(m, line.from + sign * side);
            let (from, to) = (project(m, line.from)?, project(m, line.to)?);
            // across the image of the line, not along the image of its normal
            let normal = (to - from).perp().normalize_or_zero();
            Some(Line {
                name: line.name.clone(),
                from,
                to,
                width_px: (edge(1.0)? - edge(-1.0)?).dot(normal).abs(),
            })
        };
        let round = |round: &Round| {
            let disc = round
                .disc
                .and_then(|d| disc_in_frame(m, d.center, d.radius_px));
            Some(Round {
                name: round.name.clone(),
                disc,
                outline: ring_in_frame(m, &round.outline)?,
            })
        };
        let quad = |quad: &Quad| {
            let corners = ring_in_frame(m, &quad.corners)?;
            Some(Quad {
                name: quad.name.clone(),
                corners: corners.try_into().ok()?,
            })
        };
        Self {
            lines: self.lines.iter().filter_map(line).collect(),
            discs: self.discs.iter().filter_map(round).collect(),
            quads: self.quads.iter().filter_map(quad).collect(),
        }
    }
}

/// The texels of the largest level, at most: 24 million take 384 MB with the smaller levels.
const MAX_TEXELS: f64 = 24e6;
/// Levels of the pyramid: the smallest is seen at a thirty-second of the size.
const LEVELS: usize = 6;

/// The density that was asked for, or the largest that fits into the bound.
fn bounded(extent: DVec2, texels_per_px: f64) -> f64 {
    texels_per_px.min((MAX_TEXELS / (extent.x * extent.y)).sqrt())
}

/// A painted plane.
#[derive(Debug, Clone)]
pub(crate) struct World {
    /// Extent in world pixels; its upper left corner is the origin.
    pub extent: DVec2,
    pub features: Features,
    texels_per_px: f64,
    levels: Vec<Image<LinearRgb>>,
}

impl World {
    /// A plane of at least `extent` world pixels, painted by `color_at(position, side of the sample)`.
    ///
    /// `texels_per_px` should be the largest zoom of any camera, or a little more; it is lowered where the picture would take
    /// too much memory.
    pub(crate) fn paint(
        extent: DVec2,
        texels_per_px: f64,
        color_at: impl Fn(DVec2, f64) -> Vec3 + Sync,
    ) -> Self {
        let extent = extent.max(DVec2::ONE);
        let texels_per_px = bounded(extent, texels_per_px);
        // whole texels on all levels
        let unit = 1usize << (LEVELS - 1);
        let side = |length: f64| ((length * texels_per_px) as usize / unit + 1) * unit;
        let size = Size::new(side(extent.x), side(extent.y)).expect(
            "both sides are positive and their product is bounded by MAX_TEXELS and a margin",
        );
        let largest = paint_adaptive(size, 2, |p, side| {
            color_at(p / texels_per_px, side / texels_per_px)
        });
        let mut world = Self {
            extent: DVec2::new(size.width() as f64, size.height() as f64) / texels_per_px,
            features: Features::default(),
            texels_per_px,
            levels: vec![largest],
        };
        world.reduce();
        world
    }

    /// A line of one color.
    pub(crate) fn with_line(mut self, line: Line, color: Vec3) -> Self {
        let side = 0.5 * line.width_px * (line.to - line.from).normalize_or_zero().perp();
        let ring = [
            line.from + side,
            line.to + side,
            line.to - side,
            line.from - side,
        ];
        self.draw(&ring, |_| color);
        self.features.lines.push(line);
        self
    }

    /// A disc whose color is a function of the position in units of its radius.
    pub(crate) fn with_disc(
        mut self,
        name: &str,
        disc: Disc,
        color: impl Fn(DVec2) -> Vec3,
    ) -> Self {
        let Disc { center, radius_px } = disc;
        self.draw(&disc_ring(center, radius_px), |p| {
            color((p - center) / radius_px)
        });
        let turn = std::f64::consts::TAU / OUTLINE_POINTS as f64;
        let outline = (0..OUTLINE_POINTS)
            .map(|i| center + radius_px * DVec2::from_angle(turn * i as f64))
            .collect();
        self.features.discs.push(Round {
            name: name.to_owned(),
            disc: Some(disc),
            outline,
        });
        self
    }

    /// Paints a polygon over the largest level.
    pub(crate) fn draw(&mut self, ring: &[DVec2], color: impl Fn(DVec2) -> Vec3) {
        let scale = self.texels_per_px;
        let ring: Vec<DVec2> = ring.iter().map(|&p| p * scale).collect();
        let image = &mut self.levels[0];
        if let Some(patch) = cover(image.size(), &ring) {
            for (row, values) in patch.coverage.chunks_exact(patch.width).enumerate() {
                for (col, &covered) in values.iter().enumerate().filter(|(_, c)| **c > 0.0) {
                    let (col, row) = (patch.col + col, patch.row + row);
                    let own = color(crate::paint::center(col, row) / scale);
                    let pixel = &mut image[(col, row)];
                    *pixel = LinearRgb(Vec3::from_array(pixel.0).lerp(own, covered).to_array());
                }
            }
        }
        // once for each of a few polygons: cheap beside the painting
        self.reduce();
    }

    /// The smaller levels from the largest: means of 2 × 2 texels.
    fn reduce(&mut self) {
        self.levels.truncate(1);
        for level in 0..LEVELS - 1 {
            let fine = &self.levels[level];
            let size = Size::new(fine.width() / 2, fine.height() / 2)
                .expect("the largest level is a multiple of the smallest texel");
            let mut coarse = Image::new(size, LinearRgb([0.0; 3]));
            coarse.for_each_row(|row, pixels| {
                let (upper, lower) = (fine.row(2 * row), fine.row(2 * row + 1));
                for (col, pixel) in pixels.iter_mut().enumerate() {
                    let sum = [
                        upper[2 * col],
                        upper[2 * col + 1],
                        lower[2 * col],
                        lower[2 * col + 1],
                    ]
                    .iter()
                    .fold(Vec3::ZERO, |sum, p| sum + Vec3::from_array(p.0));
                    *pixel = LinearRgb((0.25 * sum).to_array());
                }
            });
            self.levels.push(coarse);
        }
    }

    /// The plane as a camera sees it.
    pub(crate) fn render(&self, frame_from_world: &DMat3, size: Size) -> Image<LinearRgb> {
        let texel_from_frame =
            DMat3::from_scale(DVec2::splat(self.texels_per_px)) * frame_from_world.inverse();
        let mut image = Image::new(size, LinearRgb([0.0; 3]));
        image.for_each_row(|row, pixels| {
            for (col, pixel) in pixels.iter_mut().enumerate() {
                let p = crate::paint::center(col, row);
                *pixel = LinearRgb(self.pixel(&texel_from_frame, p).to_array());
            }
        });
        image
    }

    /// The mean over the pixel around `p`.
    fn pixel(&self, texel_from_frame: &DMat3, p: DVec2) -> Vec3 {
        let m = texel_from_frame;
        let h = *m * p.extend(1.0);
        let w = 1.0 / h.z;
        let q = h.truncate() * w;
        let dx = (m.x_axis.truncate() - q * m.x_axis.z) * w;
        let dy = (m.y_axis.truncate() - q * m.y_axis.z) * w;
        if !(q.is_finite() && dx.is_finite() && dy.is_finite()) {
            return Vec3::ZERO;
        }
        // the side of a quarter in texels decides on the level
        let side = 0.5 * dx.perp_dot(dy).abs().sqrt();
        let lod = if side > 1.0 { side.log2() } else { 0.0 };
        let lod = lod.min((LEVELS - 1) as f64);
        let level = (lod as usize).min(LEVELS - 2);
        let share = (lod - level as f64) as f32;
        let (right, down) = (0.25 * dx, 0.25 * dy);
        let quarters = [
            q - right - down,
            q + right - down,
            q - right + down,
            q + right + down,
        ];
        let mean = |level: usize| {
            let scale = 1.0 / (1u32 << level) as f64;
            let image = &self.levels[level];
            let sum: Vec3 = quarters.iter().map(|&q| linear(image, q * scale)).sum();
            0.25 * sum
        };
        let fine = mean(level);
        if share > 0.0 {
            fine.lerp(mean(level + 1), share)
        } else {
            fine
        }
    }
}

/// The value at a position, linear between the middles of texels.
#[inline]
fn linear(image: &Image<LinearRgb>, p: DVec2) -> Vec3 {
    let last = DVec2::new((image.width() - 1) as f64, (image.height() - 1) as f64);
    let p = (p - 0.5).clamp(DVec2::ZERO, last);
    let (col, row) = (p.x as usize, p.y as usize);
    let (s, t) = ((p.x - col as f64) as f32, (p.y - row as f64) as f32);
    let upper = image.row(row);
    let lower = image.row((row + 1).min(image.height() - 1));
    let next = (col + 1).min(image.width() - 1);
    let texel = |row: &[LinearRgb], col: usize| Vec3::from_array(row[col].0);
    let above = texel(upper, col).lerp(texel(upper, next), s);
    let below = texel(lower, col).lerp(texel(lower, next), s);
    above.lerp(below, t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(extent: DVec2, texels_per_px: f64) -> World {
        World::paint(extent, texels_per_px, |_, _| Vec3::splat(0.2))
    }

    #[test]
    fn a_ramp_is_seen_as_a_ramp_at_any_zoom() {
        let ramp = World::paint(DVec2::new(100.0, 60.0), 1.3, |p, _| {
            Vec3::new(p.x as f32 / 100.0, p.y as f32 / 60.0, 0.5)
        });
        let size = Size::new(12, 9).unwrap();
        for zoom in [0.2, 0.5, 1.0, 1.9] {
            let middle = DVec2::new(50.0, 30.0);
            let m = DMat3::from_translation(DVec2::new(6.0, 4.5))
                * DMat3::from_scale(DVec2::splat(zoom))
                * DMat3::from_translation(-middle);
            for (i, LinearRgb([r, g, b])) in ramp.render(&m, size).pixels().iter().enumerate() {
                let q = m.inverse() * crate::paint::center(i % 12, i / 12).extend(1.0);
                assert!((f64::from(*r) - q.x / 100.0).abs() < 1e-5 && (b - 0.5).abs() < 1e-6);
                assert!((f64::from(*g) - q.y / 60.0).abs() < 1e-5, "{zoom}");
            }
        }
    }

    #[test]
    fn shrinking_keeps_the_mean_of_fine_texture() {
        // a pattern of period 2 texels, shrunk by 6: one even gray
        let stripes = World::paint(DVec2::new(192.0, 192.0), 1.0, |p, _| {
            Vec3::splat(f32::from(p.x.floor().rem_euclid(2.0) < 1.0))
        });
        let size = Size::new(8, 8).unwrap();
        let m = DMat3::from_scale(DVec2::splat(1.0 / 6.0))
            * DMat3::from_translation(-DVec2::splat(60.3));
        for LinearRgb(rgb) in stripes.render(&m, size).pixels() {
            assert!((rgb[0] - 0.5).abs() < 0.02, "{rgb:?}");
        }
    }

    #[test]
    fn features_are_carried_into_the_frame() {
        let line = Line {
            name: "wire".to_owned(),
            from: DVec2::new(10.0, 20.0),
            to: DVec2::new(90.0, 20.0),
            width_px: 2.0,
        };
        let disc = Disc {
            center: DVec2::new(50.0, 40.0),
            radius_px: 8.0,
        };
        let world = gray(DVec2::new(100.0, 60.0), 1.0)
            .with_line(line, Vec3::ONE)
            .with_disc("sign", disc, |_| Vec3::ZERO);
        let twice = DMat3::from_scale_angle_translation(DVec2::splat(2.0), 0.5, DVec2::ONE);
        let seen = world.features.in_frame(&twice);
        assert!((seen.lines[0].width_px - 4.0).abs() < 1e-9);
        assert!((seen.lines[0].from.distance(seen.lines[0].to) - 160.0).abs() < 1e-9);
        assert!((seen.discs[0].disc.unwrap().radius_px - 16.0).abs() < 1e-9);
        let mut bent = DMat3::IDENTITY;
        bent.x_axis.z = 0.002;
        assert!(world.features.in_frame(&bent).discs[0].disc.is_none());
        bent.x_axis.z = -0.02;
        assert!(world.features.in_frame(&bent).lines.is_empty());
    }

    #[test]
    fn a_huge_plane_is_painted_more_coarsely() {
        assert_eq!(bounded(DVec2::new(3000.0, 2000.0), 1.5), 1.5);
        let coarse = bounded(DVec2::new(60_000.0, 20_000.0), 1.5);
        assert!((coarse * coarse * 1.2e9 - MAX_TEXELS).abs() < 1.0);
    }
}
