//! The scene that all tiles share: the projected mesh, and the materials of its points.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::camera::{Projected, Projector};
use super::color::{self, ColorMap};
use super::light::{self, Material};
use super::lines::Kind;
use super::{Legend, Paint, RenderParams};
use ravec_mesh::TriMesh;

/// Steps of a scale of colors: finer than bytes can show.
pub(super) const STEPS: usize = 1024;

/// Share of the shadows that is left where colors carry numbers: enough to see the shape, and still find the color in
/// the legend.
const RELIEF_OF_NUMBERS: f32 = 0.5;

/// Brightness of the back of a surface whose color carries numbers.
const BACK_OF_NUMBERS: f32 = 0.55;

pub(super) struct Scene<'a> {
    pub mesh: &'a TriMesh,
    pub projected: Vec<Projected>,
    pub samples_per_side: u32,
    projector: Projector,
    normals: Arc<Vec<[Vec3; 3]>>,
    /// From space to the coordinates of the view.
    turn: Mat3,
    params: &'a RenderParams,
    paint: Paint<'a>,
    scale: Option<Scale>,
    front: Vec3,
    back: Vec3,
    cut: Vec3,
    inks: [Vec3; 3],
}

/// From numbers to light.
struct Scale {
    legend: Legend,
    steps: Vec<Vec3>,
}

impl Scale {
    fn new(legend: Legend) -> Self {
        let steps = (0..STEPS)
            .map(|step| legend.map.light(step as f64 / (STEPS - 1) as f64))
            .collect();
        Self { legend, steps }
    }

    #[inline]
    fn light(&self, value: f64) -> Vec3 {
        let share = self.legend.share(value);
        if share.is_nan() {
            return self.legend.map.light(share);
        }
        self.steps[(share * (STEPS - 1) as f64).round() as usize]
    }
}

impl<'a> Scene<'a> {
    pub fn new(
        mesh: &'a TriMesh,
        projector: Projector,
        projected: Vec<Projected>,
        normals: Arc<Vec<[Vec3; 3]>>,
        paint: Paint<'a>,
        params: &'a RenderParams,
    ) -> Self {
        let ink = |style: Option<&super::LineStyle>| {
            style.map_or(Vec3::ZERO, |style| color::light(style.color))
        };
        Self {
            mesh,
            projected,
            samples_per_side: params.samples_per_side,
            turn: Mat3::from_cols_array_2d(&projector.axes.map(|axis| axis.as_vec3().to_array()))
                .transpose(),
            projector,
            normals,
            params,
            scale: paint.legend().map(Scale::new),
            paint,
            front: color::light(params.front_color),
            back: color::light(params.back_color),
            cut: color::light(params.cut_color),
            inks: [
                ink(params.wireframe.as_ref()),
                ink(params.features.as_ref().map(|features| &features.style)),
                ink(params.marked.as_ref().map(|marked| &marked.style)),
            ],
        }
    }

    pub fn legend(&self) -> Option<Legend> {
        self.scale.as_ref().map(|scale| scale.legend)
    }

    /// Samples around a tile that lines of its own samples may need.
    pub fn margin(&self) -> usize {
        let widest = self
            .line_width(Kind::Wire)
            .max(self.line_width(Kind::Feature))
            .max(self.line_width(Kind::Marked));
        if widest > 0.0 {
            (0.5 * widest).ceil() as usize + 2
        } else {
            0
        }
    }

    /// The width of lines in samples; 0 if there are none.
    pub fn line_width(&self, kind: Kind) -> f64 {
        let style = match kind {
            Kind::Wire => self.params.wireframe,
            Kind::Feature | Kind::Cut => self.params.features.map(|features| features.style),
            Kind::Marked => self.params.marked.as_ref().map(|marked| marked.style),
        };
        style.map_or(0.0, |style| {
            style.width_px * f64::from(self.samples_per_side)
        })
    }

    pub fn line_color(&self, kind: Kind) -> Vec3 {
        self.inks[match kind {
            Kind::Wire => 0,
            Kind::Feature | Kind::Cut => 1,
            Kind::Marked => 2,
        }]
    }

    /// Light and cover of where there is nothing.
    pub fn background(&self) -> (Vec3, f32) {
        match self.params.background {
            Some(color) => (color::light(color), 1.0),
            None => (Vec3::ZERO, 0.0),
        }
    }

    /// Distances of the corners beyond the cut: cut away where positive.
    #[inline]
    pub fn beyond(&self, corners: [u32; 3]) -> [f64; 3] {
        match &self.params.section {
            Some(section) => {
                corners.map(|vertex| section.beyond(self.mesh.positions()[vertex as usize]))
            }
            None => [0.0; 3],
        }
    }

    /// Returns `true` if backs stand for the inside of a solid that is cut.
    pub fn is_capped(&self) -> bool {
        self.params.section.is_some_and(|section| section.capped)
    }

    /// The light of a place of a triangle.
    pub fn light(&self, triangle: u32, weights: [f32; 3], front: bool, sample: [f64; 2]) -> Vec3 {
        if self.is_capped() && !front {
            // As if seen on the plane of the cut: flat, and equally bright from everywhere.
            return self.cut;
        }
        let material = self.material(triangle, weights, front);
        if !self.params.shaded {
            return material.color;
        }
        let [a, b, c] = self.normals[triangle as usize];
        let normal = self.turn * (weights[0] * a + weights[1] * b + weights[2] * c);
        let normal = if front { normal } else { -normal };
        let eye = self.projector.toward_eye(sample).as_vec3();
        // Smoothed normals may lean away from the eye at silhouettes.
        let away = normal.dot(eye).min(0.0);
        let normal = (normal - away * eye).try_normalize().unwrap_or(eye);
        light::shaded(material, normal, eye)
    }

    fn material(&self, triangle: u32, weights: [f32; 3], front: bool) -> Material {
        let corners = self.mesh.triangles()[triangle as usize];
        let mixed = |values: &[f64]| {
            (0..3)
                .map(|i| f64::from(weights[i]) * values[corners[i] as usize])
                .sum()
        };
        let light = |value: f64| {
            let scale = self.scale.as_ref();
            scale.map_or(self.front, |scale| scale.light(value))
        };
        let color = match self.paint {
            Paint::Plain => {
                return Material {
                    color: if front { self.front } else { self.back },
                    shine: 1.0,
                    relief: 1.0,
                };
            }
            Paint::VertexColors(colors) => (0..3)
                .map(|i| weights[i] * color::light(colors[corners[i] as usize]))
                .sum(),
            Paint::FaceColors(colors) => color::light(colors[triangle as usize]),
            Paint::VertexValues(values) => light(mixed(values.values)),
            Paint::FaceValues(values) => light(values.values[triangle as usize]),
        };
        Material {
            color: if front {
                color
            } else {
                BACK_OF_NUMBERS * color
            },
            shine: 0.0,
            relief: RELIEF_OF_NUMBERS,
        }
    }
}

impl Legend {
    /// Position of a value on the scale, from 0 to 1; NaN for NaN.
    pub fn share(&self, value: f64) -> f64 {
        if self.low < self.high {
            ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
        } else if value.is_nan() {
            value
        } else {
            0.5
        }
    }

    /// The color of a value.
    pub fn color(&self, value: f64) -> color::Rgb8 {
        self.map.color(self.share(value))
    }

    /// A scale over all finite values, symmetric about zero if it diverges.
    pub(super) fn over(values: &[f64], map: ColorMap) -> Self {
        let finite = values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        let (low, high) = match map {
            _ if low > high => (0.0, 0.0),
            ColorMap::Sequential => (low, high),
            ColorMap::Diverging => {
                let most = low.abs().max(high.abs());
                (-most, most)
            }
        };
        Self { map, low, high }
    }
}
