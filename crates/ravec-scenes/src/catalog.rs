//! All scenes by name, so that a program can list them, draw them and write their truth as data.

use crate::building::{BuildingTruth, building};
use crate::edge::{
    CheckerboardTruth, DiscTruth, EdgeTruth, GradientTruth, LineTruth, TwoColors, WedgeTruth,
    checkerboard, disc, edge, gradient, line, wedge,
};
use crate::line_art::{LineArtTruth, line_art};
use crate::plane::{PlaneTruth, facade, floor};
use crate::portraits::portraits;
use crate::random::Seed;
use crate::shapes::{ShapesTruth, shapes};
use crate::sprite::{SpriteTruth, sprite};
use crate::still_life::{StillLifeTruth, still_life};
use crate::street::{StreetTruth, street};
use crate::swatches::{SwatchesTruth, swatches};
use glam::DVec2;
use ravec_raster::{AnyImage, Size};
use serde::{Deserialize, Serialize};

/// A scene of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneId {
    /// The street, the demonstration's picture.
    Street,
    /// Fruit and balls on a table.
    StillLife,
    /// A house front in perspective.
    Facade,
    /// A tiled floor in perspective.
    Floor,
    /// The corner of a building, seen by a camera whose lens is known.
    Building,
    /// Discs, squares and lines on a landscape.
    Shapes,
    /// Portraits of rigid shapes and lines on strong texture.
    Portraits,
    /// A line drawing.
    LineArt,
    /// All textures side by side.
    Swatches,
    /// A leaf with transparency.
    Sprite,
    /// A straight edge between grays.
    EdgeGray,
    /// A straight edge between colors.
    EdgeColor,
    /// A corner.
    Wedge,
    /// A thin line.
    Line,
    /// A disc.
    Disc,
    /// A checkerboard.
    Checkerboard,
    /// A smooth gradient.
    Gradient,
}

/// Truth about a scene, from the formulas that drew it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Truth {
    /// Planes and windows.
    Street(StreetTruth),
    /// Outlines of ellipsoids.
    StillLife(StillLifeTruth),
    /// A homography.
    Plane(PlaneTruth),
    /// A camera, vanishing points and walls.
    Building(BuildingTruth),
    /// A list of shapes.
    Shapes(ShapesTruth),
    /// Strokes.
    LineArt(LineArtTruth),
    /// Fields of textures.
    Swatches(SwatchesTruth),
    /// The outline of a leaf.
    Sprite(SpriteTruth),
    /// A line and two colors.
    Edge(EdgeTruth),
    /// Two half planes and two colors.
    Wedge(WedgeTruth),
    /// A line, its width and two colors.
    Line(LineTruth),
    /// A circle and two colors.
    Disc(DiscTruth),
    /// A grid and two colors.
    Checkerboard(CheckerboardTruth),
    /// Four colors.
    Gradient(GradientTruth),
}

/// A drawn scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Its name, as in [`SceneId::name`].
    pub name: &'static str,
    /// Its seed.
    pub seed: Seed,
    /// The picture in linear light, 0 to 1; with alpha for [`SceneId::Sprite`].
    pub image: AnyImage,
    /// Its truth.
    pub truth: Truth,
}

impl SceneId {
    /// All scenes, the demonstration's first.
    pub const ALL: [Self; 17] = [
        Self::Street,
        Self::StillLife,
        Self::Facade,
        Self::Floor,
        Self::Building,
        Self::Shapes,
        Self::Portraits,
        Self::LineArt,
        Self::Swatches,
        Self::Sprite,
        Self::EdgeGray,
        Self::EdgeColor,
        Self::Wedge,
        Self::Line,
        Self::Disc,
        Self::Checkerboard,
        Self::Gradient,
    ];

    fn entry(self) -> (&'static str, (usize, usize), &'static str) {
        match self {
            Self::Street => (
                "street",
                (1536, 1024),
                "a paved street between two rows of houses on a sunny afternoon",
            ),
            Self::StillLife => (
                "still-life",
                (1200, 800),
                "fruit and glossy balls on a striped cloth on a wooden table",
            ),
            Self::Facade => (
                "facade",
                (960, 720),
                "a house front in perspective, in the shade of a tree",
            ),
            Self::Floor => (
                "floor",
                (960, 720),
                "a tiled floor in perspective with sun through windows",
            ),
            Self::Building => (
                "building",
                (960, 720),
                "the corner of a building with three vanishing points",
            ),
            Self::Shapes => (
                "shapes",
                (960, 640),
                "discs, squares and long straight lines on a landscape",
            ),
            Self::Portraits => (
                "portraits",
                (720, 480),
                "figures of a disc and a square, and lines, on rough ground",
            ),
            Self::LineArt => (
                "line-art",
                (800, 800),
                "a line drawing: strokes, curves, hatching and lettering",
            ),
            Self::Swatches => (
                "swatches",
                (1024, 512),
                "noise, cells, wood, marble, brick, tiles, grass and leaves",
            ),
            Self::Sprite => (
                "sprite",
                (256, 256),
                "a leaf with a soft edge on transparency",
            ),
            Self::EdgeGray => (
                "edge-gray",
                (128, 128),
                "a straight edge between two grays, 64 of 255 steps apart",
            ),
            Self::EdgeColor => (
                "edge-color",
                (128, 128),
                "a straight edge between two colors",
            ),
            Self::Wedge => (
                "wedge",
                (128, 128),
                "a corner of known tip, direction and opening",
            ),
            Self::Line => (
                "line",
                (128, 128),
                "a straight line of about one and a half pixels",
            ),
            Self::Disc => ("disc", (128, 128), "a disc of known center and radius"),
            Self::Checkerboard => (
                "checkerboard",
                (128, 128),
                "a checkerboard whose cells are no whole number of pixels",
            ),
            Self::Gradient => (
                "gradient",
                (256, 128),
                "a smooth transition between four colors",
            ),
        }
    }

    /// The name that selects the scene.
    pub fn name(self) -> &'static str {
        self.entry().0
    }

    /// The scene of a name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|id| id.name() == name)
    }

    /// One line about the picture.
    pub fn description(self) -> &'static str {
        self.entry().2
    }

    /// The size at which the scene shows what it is for.
    ///
    /// # Panics
    /// Never: the catalogue's sizes are valid.
    pub fn default_size(self) -> Size {
        let (width, height) = self.entry().1;
        Size::new(width, height).expect("the catalogue's sizes are small and not zero")
    }

    /// The seed of the picture in the documentation.
    pub fn default_seed(self) -> Seed {
        Seed(1)
    }
}

/// The focal length of the building's camera, in diagonals of the picture: a moderate wide angle, 35 mm on film.
const BUILDING_FOCAL: f64 = 0.81;

/// Draws a scene, in the caller's thread pool. Equal arguments give equal bytes.
pub fn render(id: SceneId, size: Size, seed: Seed) -> Scene {
    let (image, truth): (AnyImage, Truth) = match id {
        SceneId::Street => known(street(size, seed), Truth::Street),
        SceneId::StillLife => known(still_life(size, seed), Truth::StillLife),
        SceneId::Facade => known(facade(size, seed), Truth::Plane),
        SceneId::Floor => known(floor(size, seed), Truth::Plane),
        SceneId::Building => known(building(size, BUILDING_FOCAL, seed), Truth::Building),
        SceneId::Shapes => known(shapes(size, seed), Truth::Shapes),
        SceneId::Portraits => known(portraits(size, seed), Truth::Shapes),
        SceneId::LineArt => known(line_art(size, seed), Truth::LineArt),
        SceneId::Swatches => known(swatches(size, seed), Truth::Swatches),
        SceneId::Sprite => known(sprite(size, seed), Truth::Sprite),
        _ => figure(id, size, seed),
    };
    Scene {
        name: id.name(),
        seed,
        image,
        truth,
    }
}

fn known<P, T>(
    (image, truth): (ravec_raster::Image<P>, T),
    kind: impl Fn(T) -> Truth,
) -> (AnyImage, Truth)
where
    AnyImage: From<ravec_raster::Image<P>>,
{
    (image.into(), kind(truth))
}

/// The simple figures: their geometry is drawn by the seed around the middle of the picture.
fn figure(id: SceneId, size: Size, seed: Seed) -> (AnyImage, Truth) {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let unit = extent.min_element();
    let shift = DVec2::new(
        seed.between(0, 0, 0, -0.1, 0.1),
        seed.between(0, 0, 1, -0.1, 0.1),
    );
    let middle = extent * 0.5 + unit * shift;
    let angle_rad = seed.between(0, 0, 2, 0.0, std::f64::consts::TAU);
    let pick = |k: u64| [0, 1, 2].map(|c| seed.between(1, 0, 10 * k + c, 20.0, 235.0) as f32);
    let colors = TwoColors::from_encoded(pick(1), pick(2));
    let gray = TwoColors::gray_step(seed.between(0, 0, 3, 64.0, 192.0) as f32, 64.0);
    match id {
        SceneId::EdgeGray => {
            let truth = EdgeTruth::from_angle(angle_rad, middle, gray);
            (edge(size, &truth).into(), Truth::Edge(truth))
        }
        SceneId::Wedge => {
            let opening_rad = seed.between(0, 0, 4, 0.4, 2.6);
            let truth = WedgeTruth::from_axis(middle, angle_rad, opening_rad, colors);
            (wedge(size, &truth).into(), Truth::Wedge(truth))
        }
        SceneId::Line => {
            let normal = DVec2::from_angle(angle_rad);
            let truth = LineTruth {
                normal,
                offset_px: normal.dot(middle),
                width_px: seed.between(0, 0, 5, 1.0, 2.0),
                colors,
            };
            (line(size, &truth).into(), Truth::Line(truth))
        }
        SceneId::Disc => {
            let truth = DiscTruth {
                center: middle,
                radius_px: unit * seed.between(0, 0, 6, 0.2, 0.4),
                colors,
            };
            (disc(size, &truth).into(), Truth::Disc(truth))
        }
        SceneId::Checkerboard => {
            let truth = CheckerboardTruth {
                origin: middle,
                cell_px: unit * seed.between(0, 0, 7, 0.07, 0.11),
                colors: gray,
            };
            (
                checkerboard(size, &truth).into(),
                Truth::Checkerboard(truth),
            )
        }
        SceneId::Gradient => {
            let corner = |k| TwoColors::from_encoded(pick(k), [0.0; 3]).inside;
            let truth = GradientTruth {
                corners: [corner(3), corner(4), corner(5), corner(6)],
            };
            (gradient(size, &truth).into(), Truth::Gradient(truth))
        }
        // all others are drawn by `render`
        _ => {
            let truth = EdgeTruth::from_angle(angle_rad, middle, colors);
            (edge(size, &truth).into(), Truth::Edge(truth))
        }
    }
}
