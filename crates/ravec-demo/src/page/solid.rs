//! Meshes as data of the page, from which its viewer draws them.
//!
//! ```text
//! one JSON object, with arrays of bytes as base64, numbers of two bytes with the lower one first
//! vertices, triangles   counts
//! low, step             place = low + step * integer, on each axis
//! positions             three integers of two bytes for each vertex
//! corners               three indices of two bytes for each triangle
//! paint                 "plain", "faces" or "vertices": what has a shade
//! palette, shades       red, green, blue for each shade; one byte for each triangle or vertex
//! back, inside          colors of backs and of cuts
//! ink, lining           colors of edges, and of creases and outlines
//! section, capped       normal and offset of what is cut away, or null; whether backs are shown as the inside
//! view                  degrees around and up at first
//! smooth, crease        degrees up to which surfaces are smooth, and from which edges are drawn, or null
//! wire                  whether all edges are drawn at first
//! marked                two indices of two bytes for each edge that is drawn in red
//! ```

use crate::error::bug;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ravec::mesh::{Keep, SimplifyError, SimplifyParams, TriMesh, simplify};
use ravec::mesh_render::{Paint, RenderParams, Values};
use ravec::progress::Progress;
use ravec_jobs::JobError;
use std::collections::HashMap;

/// The largest number of triangles of a solid on the page: some 240 KB. More would not be seen at the size of a figure.
pub const MAX_TRIANGLES: usize = 20_000;

/// A mesh with colors that can be turned on the page.
#[derive(Debug)]
pub struct Solid {
    json: String,
}

/// A color for all, for each triangle or for each vertex.
struct Shades {
    paint: &'static str,
    palette: Vec<[u8; 3]>,
    indices: Vec<u8>,
}

impl Solid {
    /// Encodes the mesh that a picture with the same `paint` and `params` shows.
    ///
    /// Simplifies one of more than [`MAX_TRIANGLES`] while edges that are marked stay. Returns none if there is no triangle,
    /// if there would still be too many, or if numbers or colors of more triangles than that would get lost.
    ///
    /// # Errors
    /// [`JobError::Cancelled`].
    pub fn new(
        mesh: &TriMesh,
        paint: &Paint<'_>,
        params: &RenderParams,
        progress: &Progress,
    ) -> Result<Option<Self>, JobError> {
        let marked = params
            .marked
            .as_ref()
            .map_or(&[][..], |marked| &marked.edges);
        if mesh.triangles().len() <= MAX_TRIANGLES {
            return Ok(encoded(mesh, paint, marked, params));
        }
        if !matches!(paint, Paint::Plain | Paint::FaceColors(_)) {
            return Ok(None);
        }
        let fewer = SimplifyParams {
            target_triangles: MAX_TRIANGLES as u64,
            // the page shows it, nobody builds on it
            avoid_intersections: false,
            ..SimplifyParams::default()
        };
        let keep = Keep {
            features: marked,
            ..Keep::default()
        };
        let simple = match simplify(mesh, &fewer, &keep, |_| false, progress) {
            Ok(simple) => simple,
            Err(SimplifyError::Cancelled(_)) => return Err(JobError::Cancelled),
            Err(other) => return Err(bug("the simplification of a solid", &other)),
        };
        if simple.mesh.triangles().len() > MAX_TRIANGLES {
            return Ok(None);
        }
        let colors: Vec<[u8; 3]> = match paint {
            Paint::FaceColors(colors) => {
                let origins = simple.triangle_origin.iter();
                origins.map(|&origin| colors[origin as usize]).collect()
            }
            _ => Vec::new(),
        };
        let paint = match paint {
            Paint::FaceColors(_) => Paint::FaceColors(&colors),
            _ => Paint::Plain,
        };
        Ok(encoded(&simple.mesh, &paint, &simple.features, params))
    }

    /// The data as JSON, which holds no character that HTML would take for markup.
    pub fn json(&self) -> &str {
        &self.json
    }
}

/// The data of a mesh that is small enough.
fn encoded(
    mesh: &TriMesh,
    paint: &Paint<'_>,
    marked: &[[u32; 2]],
    params: &RenderParams,
) -> Option<Solid> {
    let shades = Shades::new(paint, params)?;
    // vertices without a triangle are left out, as they are not seen and would count for the frame
    let mut used: Vec<u32> = mesh.triangles().iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let index = |vertex: u32| used.binary_search(&vertex).ok().map(|at| at as u16);
    let places: Vec<_> = used
        .iter()
        .map(|&vertex| mesh.positions()[vertex as usize])
        .collect();
    let first = *places.first()?;
    let (low, high) = places
        .iter()
        .fold((first, first), |(low, high), &p| (low.min(p), high.max(p)));
    let side = (high - low).max_element();
    let step = if side > 0.0 {
        side / f64::from(u16::MAX)
    } else {
        1.0
    };
    let positions = places.iter().flat_map(|&p| {
        let steps = (p - low) / step;
        steps.to_array().map(|steps| steps.round() as u16)
    });
    let corners = mesh.triangles().iter().flatten();
    let ends = marked
        .iter()
        .filter_map(|&[a, b]| Some([index(a)?, index(b)?]));
    let picked = |values: &[u8]| match shades.paint {
        "vertices" => used.iter().map(|&v| values[v as usize]).collect(),
        _ => values.to_vec(),
    };
    let section = params.section.map(|section| {
        let [x, y, z] = section.normal.to_array();
        [x, y, z, section.offset]
    });
    let view = params.camera.view;
    let json = serde_json::json!({
        "vertices": used.len(),
        "triangles": mesh.triangles().len(),
        "low": low.to_array(),
        "step": step,
        "positions": shorts(positions),
        "corners": shorts(corners.filter_map(|&vertex| index(vertex))),
        "paint": shades.paint,
        "palette": STANDARD.encode(shades.palette.concat()),
        "shades": STANDARD.encode(picked(&shades.indices)),
        "back": params.back_color,
        "inside": params.cut_color,
        "ink": params.wireframe.map_or([40, 44, 52], |style| style.color),
        "lining": params.features.map_or([24, 28, 34], |features| features.style.color),
        "section": section,
        "capped": params.section.is_some_and(|section| section.capped),
        "view": [view.azimuth_deg, view.elevation_deg],
        "smooth": params.smooth_angle_deg,
        "crease": params.features.map(|features| features.angle_deg),
        "wire": params.wireframe.is_some(),
        "marked": shorts(ends.flatten()),
    });
    Some(Solid {
        json: json.to_string(),
    })
}

impl Shades {
    /// Up to 256 colors, or none if there are more.
    fn new(paint: &Paint<'_>, params: &RenderParams) -> Option<Self> {
        match paint {
            Paint::Plain => Some(Self {
                paint: "plain",
                palette: vec![params.front_color],
                indices: Vec::new(),
            }),
            Paint::FaceColors(colors) => {
                let (mut palette, mut known) = (Vec::new(), HashMap::new());
                let mut shades = Vec::with_capacity(colors.len());
                for &color in *colors {
                    let shade = *known.entry(color).or_insert_with(|| {
                        palette.push(color);
                        palette.len() - 1
                    });
                    shades.push(u8::try_from(shade).ok()?);
                }
                Some(Self {
                    paint: "faces",
                    palette,
                    indices: shades,
                })
            }
            Paint::VertexValues(values) => Some(Self {
                paint: "vertices",
                palette: (0..=255u8)
                    .map(|shade| values.map.color(f64::from(shade) / 255.0))
                    .collect(),
                indices: shares(values),
            }),
            Paint::VertexColors(_) | Paint::FaceValues(_) => None,
        }
    }
}

/// Position of each number on the scale of 256 colors.
fn shares(values: &Values<'_>) -> Vec<u8> {
    let [low, high] = values.range.unwrap_or_else(|| {
        let finite = values.values.iter().filter(|value| value.is_finite());
        finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &value| {
            [low.min(value), high.max(value)]
        })
    });
    let share = |value: &f64| (255.0 * (value - low) / (high - low)).round();
    // what is no number becomes 0
    values
        .values
        .iter()
        .map(|value| share(value) as u8)
        .collect()
}

/// Numbers of two bytes as base64, the lower byte first.
fn shorts(values: impl Iterator<Item = u16>) -> String {
    let bytes: Vec<u8> = values.flat_map(u16::to_le_bytes).collect();
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use ravec::mesh_render::{ColorMap, LineStyle, MarkedEdges, Section};
    use ravec_scenes::solids::{cuboid, icosphere};

    fn solid(mesh: &TriMesh, paint: &Paint<'_>, params: &RenderParams) -> serde_json::Value {
        let solid = Solid::new(mesh, paint, params, &Progress::none())
            .unwrap()
            .unwrap();
        assert!(!solid.json().contains(['<', '>', '&']));
        let data: serde_json::Value = serde_json::from_str(solid.json()).unwrap();
        let bytes = |name: &str| STANDARD.decode(data[name].as_str().unwrap()).unwrap();
        let count = |name: &str| data[name].as_u64().unwrap() as usize;
        assert_eq!(bytes("positions").len(), 6 * count("vertices"));
        assert_eq!(bytes("corners").len(), 6 * count("triangles"));
        let corners = bytes("corners");
        let mut corners = corners.chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]]));
        assert!(corners.all(|corner| usize::from(corner) < count("vertices")));
        let shades = bytes("shades");
        match data["paint"].as_str().unwrap() {
            "faces" => assert_eq!(shades.len(), count("triangles")),
            "vertices" => assert_eq!(shades.len(), count("vertices")),
            _ => assert!(shades.is_empty()),
        }
        let colors = bytes("palette").len() / 3;
        assert!(shades.iter().all(|&shade| usize::from(shade) < colors));
        data
    }

    #[test]
    fn places_are_those_of_the_mesh_up_to_half_a_step() {
        let mesh = cuboid(DVec3::new(4.0, 2.0, 1.0)).mesh;
        let section = Section {
            normal: DVec3::X,
            offset: 0.5,
            capped: true,
        };
        let params = RenderParams {
            section: Some(section),
            ..RenderParams::default()
        };
        let data = solid(&mesh, &Paint::Plain, &params);
        assert_eq!(data["section"], serde_json::json!([1.0, 0.0, 0.0, 0.5]));
        let step = data["step"].as_f64().unwrap();
        let bytes = STANDARD.decode(data["positions"].as_str().unwrap());
        let bytes = bytes.unwrap();
        for (vertex, place) in bytes.chunks(6).zip(mesh.positions()) {
            for axis in 0..3 {
                let steps = u16::from_le_bytes([vertex[2 * axis], vertex[2 * axis + 1]]);
                let at = data["low"][axis].as_f64().unwrap() + step * f64::from(steps);
                assert!((at - place[axis]).abs() <= 0.5 * step + 1e-12);
            }
        }
    }

    #[test]
    fn colors_of_triangles_and_numbers_of_vertices_become_shades() {
        let mesh = icosphere(1.0, 2).mesh;
        let count = mesh.triangles().len();
        let colors: Vec<_> = (0..count).map(|t| [(t % 3) as u8, 0, 9]).collect();
        let params = RenderParams {
            marked: Some(MarkedEdges {
                edges: vec![[mesh.triangles()[0][0], mesh.triangles()[0][1]]],
                style: LineStyle {
                    color: [1, 2, 3],
                    width_px: 1.0,
                },
            }),
            ..RenderParams::default()
        };
        let data = solid(&mesh, &Paint::FaceColors(&colors), &params);
        assert_eq!(data["triangles"], count);
        assert_eq!(
            STANDARD.decode(data["palette"].as_str().unwrap()).unwrap(),
            [0, 0, 9, 1, 0, 9, 2, 0, 9]
        );
        assert_eq!(
            STANDARD
                .decode(data["marked"].as_str().unwrap())
                .unwrap()
                .len(),
            4
        );
        let values: Vec<_> = mesh.positions().iter().map(|p| p.z).collect();
        let paint = Paint::VertexValues(Values {
            values: &values,
            map: ColorMap::Sequential,
            range: Some([-1.0, 1.0]),
        });
        let data = solid(&mesh, &paint, &RenderParams::default());
        let shades = STANDARD.decode(data["shades"].as_str().unwrap()).unwrap();
        let top = values.iter().position(|&z| z > 0.999);
        assert!(top.is_none_or(|top| shades[top] > 250));
    }

    #[test]
    fn large_meshes_are_simplified_and_keep_their_colors() {
        let mesh = icosphere(1.0, 6).mesh;
        assert!(mesh.triangles().len() > MAX_TRIANGLES);
        let upper = |t: &[u32; 3]| mesh.positions()[t[0] as usize].z > 0.0;
        let colors: Vec<_> = mesh
            .triangles()
            .iter()
            .map(|t| if upper(t) { [255, 0, 0] } else { [0, 0, 255] })
            .collect();
        let params = RenderParams::default();
        let data = solid(&mesh, &Paint::FaceColors(&colors), &params);
        let triangles = data["triangles"].as_u64().unwrap() as usize;
        assert!((MAX_TRIANGLES - 10..=MAX_TRIANGLES).contains(&triangles));
        let again = solid(&mesh, &Paint::FaceColors(&colors), &params);
        assert_eq!(data, again);
        let values = vec![0.0; mesh.positions().len()];
        let numbers = Paint::VertexValues(Values {
            values: &values,
            map: ColorMap::Sequential,
            range: None,
        });
        assert!(
            Solid::new(&mesh, &numbers, &params, &Progress::none())
                .unwrap()
                .is_none()
        );
    }
}
