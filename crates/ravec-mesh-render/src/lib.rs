//! Pictures of triangle meshes, without a window: depth, shading, edges, colors by value and cuts.
//!
//! Triangles are sorted into tiles, and each tile is drawn on its own: nearest triangle for each sample, light, lines, mean
//! over the samples of a pixel. Hidden lines are removed by depth; backs are shaded, too, in another color.
//!
//! ```
//! use glam::DVec3;
//! use ravec_mesh::TriMesh;
//! use ravec_mesh_render::{Paint, RenderParams, render};
//! use ravec_progress::Progress;
//!
//! let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
//! let mesh = TriMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
//! let params = RenderParams { width: 64, height: 64, ..RenderParams::default() };
//! let rendering = render(&mesh, &Paint::Plain, &params, &Progress::none())?;
//! assert_eq!(rendering.picture.pixels.len(), 4 * 64 * 64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is here
//!
//! | for | use |
//! | --- | --- |
//! | a picture | [`render`], [`RenderParams`], [`Rendering`] |
//! | many views of a mesh | [`PreparedMesh`] |
//! | the place of the eye | [`Camera`], [`View`], [`Projection`], [`Target`] |
//! | places in the picture | [`ScreenMap`], [`Sight`] |
//! | colors | [`Paint`], [`Values`], [`ColorMap`], [`Legend`] |
//! | lines | [`FeatureLines`], [`MarkedEdges`], [`LineStyle`] |
//! | a section | [`Section`] |
//! | pictures on a GPU, feature `gpu` | `gpu` |
//!
//! # Guarantees
//!
//! - The same picture, bit for bit, on any number of threads.
//! - No gaps and no double samples between neighboring triangles.
//! - Any soup will do, also an empty one.
//!
//! # Not guaranteed
//!
//! - An order among surfaces that are nearer to each other than 1e-7 of the depth of the mesh.
//!
//! # Words
//!
//! *Sample*: a place inside a pixel where the nearest triangle is looked up. *Tile*: a square of pixels. *Silhouette*: edges
//! at which the surface turns away from the eye. *Crease*: an edge at which normals differ. *Cap*: the color on a cut solid.
//! *Legend*: the scale of colors and the values at its ends.
//!
//! # Costs
//!
//! About a second and core for a million triangles and a million pixels of 9 samples; 150 bytes a triangle.

mod camera;
mod color;
mod edges;
#[cfg(feature = "gpu")]
pub mod gpu;
mod light;
mod lines;
mod normals;
mod prepared;
mod scene;
mod screen_map;
mod tile;

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use camera::{Projected, Projector};
use prepared::Prepared;
use ravec_mesh::TriMesh;
use ravec_mesh::par_collect;
use scene::Scene;
use tile::{TILE_PX, Tile};

pub use camera::{Camera, Projection, Target, UpAxis, View};
pub use color::{ColorMap, Rgb8};
pub use prepared::PreparedMesh;
pub use screen_map::{ScreenMap, Sight};

/// Style of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineStyle {
    /// Its color.
    pub color: Rgb8,
    /// Its width in pixels, above 0, at most 64.
    pub width_px: f64,
}

/// Lines where the surface has an edge: creases, borders, and edges of three and more triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureLines {
    /// Edges are drawn where normals differ by more, 0 to 180 degrees (default 30). Less draws more.
    pub angle_deg: f64,
    /// `true` if edges are drawn where the surface turns away from the eye, too (default yes).
    pub silhouettes: bool,
    /// Style of the lines (default nearly black, 1.25 pixels wide).
    pub style: LineStyle,
}

impl Default for FeatureLines {
    fn default() -> Self {
        Self {
            angle_deg: 30.0,
            silhouettes: true,
            style: LineStyle {
                color: [24, 28, 34],
                width_px: 1.25,
            },
        }
    }
}

/// Edges that are drawn in a style of their own, over all other lines.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkedEdges {
    /// Pairs of vertices, in either order; pairs that are no edge of a triangle are not drawn.
    pub edges: Vec<[u32; 2]>,
    /// Style of the lines.
    pub style: LineStyle,
}

/// A plane that cuts the mesh open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// The side that is taken away, not zero. Its length counts: see `offset`.
    pub normal: DVec3,
    /// Points with `normal · point` above this are taken away.
    pub offset: f64,
    /// `true` if the inside is filled, so that the cut of a closed surface looks solid, rather than hollow.
    pub capped: bool,
}

impl Section {
    /// Above 0 for what is taken away.
    #[inline]
    fn beyond(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

/// Size, view and look of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderParams {
    /// Pixels from left to right, 1 to 16 384 (default 1000).
    pub width: u32,
    /// Pixels from top to bottom, 1 to 16 384 (default 1000).
    pub height: u32,
    /// Samples of a pixel along each side, 1 to 8 (default 3, nine in all). More makes smoother edges; cost grows with the
    /// square.
    pub samples_per_side: u32,
    /// Camera that views the mesh.
    pub camera: Camera,
    /// Up to which angle between triangles the surface looks smooth, 0 to 180 degrees (default 30); 0 shows each triangle
    /// flat.
    pub smooth_angle_deg: f64,
    /// `true` if light shows the shape (default yes); else all of a surface has its own color, as in line drawings.
    pub shaded: bool,
    /// The color of the outside (default a bluish gray).
    pub front_color: Rgb8,
    /// The color of the inside, so that flipped and open parts are seen (default a brick red).
    pub back_color: Rgb8,
    /// The color of the solid where it is cut (default ocher).
    pub cut_color: Rgb8,
    /// The color behind the mesh (default white); transparent if not given.
    pub background: Option<Rgb8>,
    /// Edges of all triangles (default none).
    pub wireframe: Option<LineStyle>,
    /// Creases, borders and outlines, also of a cut (default those of [`FeatureLines`]).
    pub features: Option<FeatureLines>,
    /// Edges to be marked (default none).
    pub marked: Option<MarkedEdges>,
    /// Section that cuts a part away (default none).
    pub section: Option<Section>,
}

impl Default for RenderParams {
    fn default() -> Self {
        Self {
            width: 1000,
            height: 1000,
            samples_per_side: 3,
            camera: Camera::default(),
            smooth_angle_deg: 30.0,
            shaded: true,
            front_color: [178, 192, 208],
            back_color: [196, 100, 78],
            cut_color: [226, 178, 104],
            background: Some([255, 255, 255]),
            wireframe: None,
            features: Some(FeatureLines::default()),
            marked: None,
            section: None,
        }
    }
}

/// Numbers to be shown as colors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Values<'a> {
    /// One for each vertex or triangle. NaN is gray.
    pub values: &'a [f64],
    /// The scale of colors.
    pub map: ColorMap,
    /// The values at its ends; those of the smallest and the largest finite value if not given, symmetric about zero
    /// for [`ColorMap::Diverging`].
    pub range: Option<[f64; 2]>,
}

/// Source of the colors of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Paint<'a> {
    /// The colors of front and back in [`RenderParams`].
    #[default]
    Plain,
    /// A color for each vertex.
    VertexColors(&'a [Rgb8]),
    /// A color for each triangle.
    FaceColors(&'a [Rgb8]),
    /// A number for each vertex.
    VertexValues(Values<'a>),
    /// A number for each triangle.
    FaceValues(Values<'a>),
}

impl Paint<'_> {
    fn legend(&self) -> Option<Legend> {
        match self {
            Self::VertexValues(values) | Self::FaceValues(values) => Some(match values.range {
                Some([low, high]) => Legend {
                    map: values.map,
                    low,
                    high,
                },
                None => Legend::over(values.values, values.map),
            }),
            Self::Plain | Self::VertexColors(_) | Self::FaceColors(_) => None,
        }
    }

    /// Fails if colors or numbers do not fit the mesh.
    fn check(&self, mesh: &TriMesh) -> Result<(), RenderError> {
        match self.lengths(mesh) {
            Some((got, expected)) if got != expected => Err(RenderError::Paint { got, expected }),
            _ => Ok(()),
        }
    }

    /// Number of colors or numbers, and the required number.
    fn lengths(&self, mesh: &TriMesh) -> Option<(usize, usize)> {
        let (vertices, triangles) = (mesh.positions().len(), mesh.triangles().len());
        match self {
            Self::Plain => None,
            Self::VertexColors(colors) => Some((colors.len(), vertices)),
            Self::FaceColors(colors) => Some((colors.len(), triangles)),
            Self::VertexValues(values) => Some((values.values.len(), vertices)),
            Self::FaceValues(values) => Some((values.values.len(), triangles)),
        }
    }
}

/// Colors that stand for numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Legend {
    /// The scale of colors.
    pub map: ColorMap,
    /// The value at its start.
    pub low: f64,
    /// The value at its end.
    pub high: f64,
}

/// Pixels in memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue as sRGB and straight alpha of each pixel, row by row from the top.
    pub pixels: Vec<u8>,
}

/// A picture and how to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendering {
    /// The picture.
    pub picture: Picture,
    /// Legend of the colors, if they stand for numbers.
    pub legend: Option<Legend>,
}

/// Why there is no picture.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// Width or height out of range.
    #[error("the picture is {width} by {height} pixels: choose 1 to 16384 each way")]
    Size {
        /// Requested value.
        width: u32,
        /// Requested value.
        height: u32,
    },
    /// A number of samples out of range.
    #[error("the number of samples along each side of a pixel is {0}: choose 1 to 8")]
    Samples(u32),
    /// The camera's angles, frame or zoom make no sense.
    #[error(
        "the camera needs finite angles, a field of view of 1 to 150 degrees, a frame that is not empty and a positive zoom"
    )]
    Camera,
    /// A line's width or an angle out of range.
    #[error(
        "a line style is out of range: choose widths of up to 64 pixels and edge angles of 0 to 180 degrees"
    )]
    Lines,
    /// The cut's plane has no direction or no place.
    #[error("the plane of a cut needs a finite normal that is not zero, and a finite offset")]
    Section,
    /// Too few or too many colors or numbers.
    #[error("{got} colors or numbers do not fit {expected} vertices or triangles")]
    Paint {
        /// Number of entries.
        got: usize,
        /// Required number of entries.
        expected: usize,
    },
    /// An array that the GPU does not hold in one piece.
    #[error("the mesh needs {bytes} bytes in one piece, and the GPU offers {limit}")]
    DeviceMemory {
        /// Size of the array.
        bytes: u64,
        /// Largest size.
        limit: u64,
    },
    /// The GPU refused the work, is lost, or its memory is exhausted.
    #[error("the GPU refuses to draw the mesh")]
    Device,
    /// The work was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl RenderParams {
    fn check(&self) -> Result<(), RenderError> {
        let (width, height) = (self.width, self.height);
        if ![width, height].iter().all(|px| (1..=16_384).contains(px)) {
            return Err(RenderError::Size { width, height });
        }
        if !(1..=8).contains(&self.samples_per_side) {
            return Err(RenderError::Samples(self.samples_per_side));
        }
        if !self.camera.is_valid() {
            return Err(RenderError::Camera);
        }
        let styles = [
            self.wireframe,
            self.features.map(|features| features.style),
            self.marked.as_ref().map(|marked| marked.style),
        ];
        let widths = styles
            .iter()
            .flatten()
            .all(|style| style.width_px > 0.0 && style.width_px <= 64.0);
        let angles = [
            Some(self.smooth_angle_deg),
            self.features.map(|features| features.angle_deg),
        ];
        if !widths
            || !angles
                .iter()
                .flatten()
                .all(|angle| (0.0..=180.0).contains(angle))
        {
            return Err(RenderError::Lines);
        }
        let is_plane = |section: &Section| {
            section.normal.is_finite()
                && section.normal != DVec3::ZERO
                && section.offset.is_finite()
        };
        if !self.section.as_ref().is_none_or(is_plane) {
            return Err(RenderError::Section);
        }
        Ok(())
    }
}

/// The picture of `mesh`.
///
/// # Errors
/// [`RenderError::Size`], [`RenderError::Samples`], [`RenderError::Camera`], [`RenderError::Lines`] and
/// [`RenderError::Section`] for parameters out of range, [`RenderError::Paint`] if colors or numbers do not fit the mesh, and
/// [`RenderError::Cancelled`] soon after `progress` is cancelled.
pub fn render(
    mesh: &TriMesh,
    paint: &Paint<'_>,
    params: &RenderParams,
    progress: &Progress,
) -> Result<Rendering, RenderError> {
    draw(mesh, &Prepared::default(), paint, params, progress)
}

fn draw(
    mesh: &TriMesh,
    prepared: &Prepared,
    paint: &Paint<'_>,
    params: &RenderParams,
    progress: &Progress,
) -> Result<Rendering, RenderError> {
    params.check()?;
    paint.check(mesh)?;
    progress.check()?;
    let side = params.samples_per_side;
    let size = [params.width * side, params.height * side].map(f64::from);
    let projector = Projector::new(
        &params.camera,
        prepared.used(mesh),
        prepared.bounds(mesh),
        size,
    );
    let positions = mesh.positions();
    let projected = par_collect(positions.len(), progress, |vertex| {
        [snapped(projector.project(positions[vertex as usize]))]
    })?;
    let normals = prepared.normals(mesh, params.smooth_angle_deg, progress)?;
    let lines = lines::lines(mesh, prepared, &projected, &projector, params, progress)?;
    let scene = Scene::new(mesh, projector, projected, normals, *paint, params);
    let grid = Grid {
        columns: params.width.div_ceil(TILE_PX),
        rows: params.height.div_ceil(TILE_PX),
        tile: f64::from(TILE_PX * side),
    };
    let margin = scene.margin() as f64;
    let triangles_of = grid.sort(mesh.triangles().len(), progress, |triangle| {
        let corners = mesh.triangles()[triangle as usize];
        if scene.beyond(corners).iter().all(|&beyond| beyond > 0.0) {
            return None;
        }
        Some(corners.map(|vertex| scene.projected[vertex as usize])).map(|at| around(&at, margin))
    })?;
    let lines_of = grid.sort(lines.len(), progress, |line| {
        let line = &lines[line as usize];
        Some(around(&line.ends, 0.5 * scene.line_width(line.kind) + 1.0))
    })?;
    let tiles = grid.columns * grid.rows;
    let phase = progress.phase("render", tiles.into());
    let drawn: Vec<Vec<[f32; 4]>> = (0..tiles)
        .into_par_iter()
        .map(|index| {
            progress.check()?;
            let (from, size) = grid.pixels(index, params);
            let mut tile = Tile::new(&scene, from, size);
            for part in &triangles_of {
                for triangles in part[index as usize].chunks(DRAWN_AT_ONCE) {
                    progress.check()?;
                    for &triangle in triangles {
                        tile.draw(triangle);
                    }
                }
            }
            for part in &lines_of {
                for drawn in part[index as usize].chunks(DRAWN_AT_ONCE) {
                    progress.check()?;
                    for &line in drawn {
                        tile.ink(&lines[line as usize]);
                    }
                }
            }
            let pixels = tile.pixels();
            phase.advance(1);
            Ok(pixels)
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut pixels = vec![0; 4 * params.width as usize * params.height as usize];
    for (index, drawn) in (0..tiles).zip(drawn) {
        let (from, size) = grid.pixels(index, params);
        for (row, drawn) in (from[1]..).zip(drawn.chunks_exact(size[0] as usize)) {
            let start = 4 * (row as usize * params.width as usize + from[0] as usize);
            for (pixel, &light) in pixels[start..].chunks_exact_mut(4).zip(drawn) {
                pixel.copy_from_slice(&straight(light));
            }
        }
    }
    Ok(Rendering {
        picture: Picture {
            width: params.width,
            height: params.height,
            pixels,
        },
        legend: scene.legend(),
    })
}

/// The places of the vertices that triangles use.
fn used_positions(mesh: &TriMesh) -> Vec<DVec3> {
    let mut used = vec![false; mesh.positions().len()];
    for &vertex in mesh.triangles().iter().flatten() {
        used[vertex as usize] = true;
    }
    let positions = mesh.positions().iter().zip(used);
    positions
        .filter(|(_, used)| *used)
        .map(|(&at, _)| at)
        .collect()
}

/// Rounded to a 256th of a sample, which makes edge functions exact.
fn snapped(at: Projected) -> Projected {
    Projected {
        x: (at.x * 256.0).round() / 256.0,
        y: (at.y * 256.0).round() / 256.0,
        ..at
    }
}

/// The least and the most of the columns, then of the rows, that points reach with a margin.
fn around(points: &[Projected], margin: f64) -> [f64; 4] {
    let start = [
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
    ];
    points.iter().fold(start, |[left, right, top, bottom], at| {
        [
            left.min(at.x - margin),
            right.max(at.x + margin),
            top.min(at.y - margin),
            bottom.max(at.y + margin),
        ]
    })
}

/// From premultiplied linear light to a pixel.
fn straight([r, g, b, alpha]: [f32; 4]) -> [u8; 4] {
    if alpha <= 0.0 {
        return [0; 4];
    }
    let [r, g, b] = color::encoded(glam::Vec3::new(r, g, b) / alpha);
    [r, g, b, (alpha.min(1.0) * 255.0).round() as u8]
}

/// The tiles of a picture.
struct Grid {
    columns: u32,
    rows: u32,
    /// Samples along the side of a tile.
    tile: f64,
}

/// Things that are sorted at a time.
const PART: u32 = 1 << 16;

/// Triangles or lines of a tile that are drawn between two checks for cancellation.
const DRAWN_AT_ONCE: usize = 1 << 10;

impl Grid {
    /// The pixel at which a tile starts, and its size in pixels.
    fn pixels(&self, index: u32, params: &RenderParams) -> ([u32; 2], [u32; 2]) {
        let from = [
            index % self.columns * TILE_PX,
            index / self.columns * TILE_PX,
        ];
        let left = [params.width - from[0], params.height - from[1]];
        (from, left.map(|px| px.min(TILE_PX)))
    }

    /// For each part of the things, in order, and each tile: the things that reach the tile, in order.
    fn sort(
        &self,
        count: usize,
        progress: &Progress,
        reach: impl Fn(u32) -> Option<[f64; 4]> + Sync,
    ) -> Result<Vec<Vec<Vec<u32>>>, Cancelled> {
        let count = count as u32;
        (0..count.div_ceil(PART))
            .into_par_iter()
            .map(|part| {
                progress.check()?;
                let mut tiles = vec![Vec::new(); (self.columns * self.rows) as usize];
                for thing in part * PART..count.min((part + 1).saturating_mul(PART)) {
                    let Some([left, right, top, bottom]) = reach(thing) else {
                        continue;
                    };
                    let range = |low: f64, high: f64, most: u32| {
                        let tile = |x: f64| (x / self.tile).floor().clamp(-1.0, f64::from(most));
                        let (low, high) = (tile(low).max(0.0) as u32, tile(high) + 1.0);
                        low..(high as u32).min(most)
                    };
                    for row in range(top, bottom, self.rows) {
                        for column in range(left, right, self.columns) {
                            tiles[(row * self.columns + column) as usize].push(thing);
                        }
                    }
                }
                Ok(tiles)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
