//! The look of a mesh on the canvas, as parameters of its pictures.

use super::pace::Quality;
use super::{MarkedPlace, ShownMesh};
use ravec::mesh_render::{
    Camera, FeatureLines, LineStyle, MarkedEdges, Paint, RenderParams, Rgb8, Section, Values,
};
use std::sync::Arc;

/// Longest side of a picture in pixels: more than any screen has.
const MAX_SIDE: u32 = 8192;

/// The cover of the ghost.
pub(super) const GHOST_ALPHA: f32 = 0.3;

const GHOST_COLOR: Rgb8 = [96, 150, 214];
const MARK_COLOR: Rgb8 = [226, 32, 44];

/// Everything that a picture depends on.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    pub shown: Arc<ShownMesh>,
    pub ghost: Option<Arc<ShownMesh>>,
    pub camera: Camera,
    /// Pixels of the screen.
    pub size: [u32; 2],
    pub style: Style,
}

/// The look of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
pub(super) struct Style {
    pub background: Rgb8,
    pub shaded: bool,
    pub smooth: bool,
    pub all_edges: bool,
    /// Angle of feature edges in degrees.
    pub features: Option<f64>,
    pub colors: bool,
    pub marks: bool,
    pub section: Option<Section>,
    /// Pixels of a line that is one point wide.
    pub pixels_per_point: f32,
}

impl PartialEq for Wanted {
    fn eq(&self, other: &Self) -> bool {
        let ghosts = match (&self.ghost, &other.ghost) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        };
        Arc::ptr_eq(&self.shown, &other.shown)
            && ghosts
            && self.camera == other.camera
            && self.size == other.size
            && self.style == other.style
    }
}

/// The part of the look that is copied along with a mesh.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Look {
    pub has_colors: bool,
    pub is_ghost: bool,
}

impl Wanted {
    /// True if another picture shows the same at another size.
    pub fn is_resized(&self, other: &Self) -> bool {
        let same_size = Self {
            camera: self.camera,
            size: self.size,
            ..other.clone()
        };
        self.size != other.size && *self == same_size
    }

    /// The mesh and its ghost, with their looks.
    pub fn meshes(&self) -> impl Iterator<Item = (&Arc<ShownMesh>, Look)> {
        let mesh = Look {
            has_colors: self.style.colors && self.shown.values.is_some(),
            is_ghost: false,
        };
        let ghost = Look {
            has_colors: false,
            is_ghost: true,
        };
        let ghosts = self.ghost.iter().map(move |shown| (shown, ghost));
        std::iter::once((&self.shown, mesh)).chain(ghosts)
    }
}

/// The colors of the mesh of `wanted`, or of its ghost.
pub(super) fn paint(wanted: &Wanted, is_ghost: bool) -> Paint<'_> {
    match &wanted.shown.values {
        Some(values) if wanted.style.colors && !is_ghost => Paint::VertexValues(Values {
            values: &values.values,
            map: values.map,
            range: values.range,
        }),
        _ => Paint::Plain,
    }
}

/// The marked edges of the mesh, whether they are shown or not.
pub(super) fn marked(wanted: &Wanted) -> Option<MarkedEdges> {
    let edges = marked_edges(&wanted.shown);
    let style = LineStyle {
        color: MARK_COLOR,
        width_px: 1.0,
    };
    (!edges.is_empty()).then_some(MarkedEdges { edges, style })
}

/// The look of the ghost of a picture.
pub(super) fn ghost_params(params: &RenderParams) -> RenderParams {
    RenderParams {
        background: None,
        front_color: GHOST_COLOR,
        back_color: GHOST_COLOR,
        marked: None,
        wireframe: None,
        shaded: true,
        ..params.clone()
    }
}

/// The pixels of a picture of a quality.
fn size(wanted: &Wanted, quality: Quality) -> [u32; 2] {
    let larger = wanted.size[0].max(wanted.size[1]);
    let divisor = quality.divisor.max(larger.div_ceil(MAX_SIDE));
    wanted.size.map(|side| side.div_ceil(divisor).max(1))
}

/// Parameters of a picture, with `edges` in the style of marks if marks are shown.
pub(super) fn params(
    wanted: &Wanted,
    quality: Quality,
    edges: Option<Vec<[u32; 2]>>,
) -> RenderParams {
    let style = &wanted.style;
    let [width, height] = size(wanted, quality);
    let scale = f64::from(style.pixels_per_point) * f64::from(width.min(height))
        / f64::from(wanted.size[0].min(wanted.size[1]).max(1));
    let line = |color: Rgb8, width: f64| LineStyle {
        color,
        width_px: (width * scale).clamp(0.5, 64.0),
    };
    let surface = |color: Rgb8| {
        if style.shaded {
            color
        } else {
            style.background
        }
    };
    let defaults = RenderParams::default();
    let dark = style.background[1] < 128;
    // lines of a drawing without shades must differ from its background
    let ink = if dark && !style.shaded {
        [206, 212, 220]
    } else {
        [24, 28, 34]
    };
    RenderParams {
        width,
        height,
        samples_per_side: quality.samples,
        camera: wanted.camera,
        smooth_angle_deg: if style.smooth {
            defaults.smooth_angle_deg
        } else {
            0.0
        },
        shaded: style.shaded,
        front_color: surface(defaults.front_color),
        back_color: surface(defaults.back_color),
        background: Some(style.background),
        wireframe: (style.all_edges && quality.lines).then(|| {
            let color = if style.shaded { [92, 104, 118] } else { ink };
            line(color, 0.7)
        }),
        features: style
            .features
            .filter(|_| quality.lines)
            .map(|angle_deg| FeatureLines {
                angle_deg: angle_deg.clamp(0.0, 180.0),
                silhouettes: true,
                style: line(ink, 1.2),
            }),
        marked: edges.filter(|_| style.marks).map(|edges| MarkedEdges {
            edges,
            style: line(MARK_COLOR, 3.0),
        }),
        section: style.section,
        ..defaults
    }
}

/// The edges of the mesh that are marked.
pub(super) fn marked_edges(shown: &ShownMesh) -> Vec<[u32; 2]> {
    let triangles = shown.mesh.triangles();
    let mut edges = Vec::new();
    for place in &shown.marked {
        match *place {
            MarkedPlace::Edge(edge) => edges.push(edge),
            MarkedPlace::Triangle(triangle) => {
                if let Some(&[a, b, c]) = triangles.get(triangle as usize) {
                    edges.extend([[a, b], [b, c], [c, a]]);
                }
            }
            MarkedPlace::Point(_) | MarkedPlace::Segment(_) => {}
        }
    }
    edges
}
