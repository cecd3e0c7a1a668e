//! The street: a paved lane between two rows of houses on a sunny afternoon.
//!
//! The picture the rest of the toolkit is shown on. It has long straight edges towards a vanishing point, edges at all
//! angles (gables, timber, flags), smooth gradients (sky, plaster, shadows), fine texture (setts, bricks, leaves), thin
//! structures (wires, spokes, window bars) and lettering. Its truth: where each house front and the ground lie in the
//! picture, and the corners of all windows.
//!
//! Cost: about two microseconds a pixel and core.

use crate::facade::{Facade, Gable, Wall};
use crate::furniture::{awning, bicycle, church, hanging_sign, lamp};
use crate::greenery::{flower_box, pot, tree};
use crate::paint::{hex, paint_adaptive};
use crate::props::Prop;
use crate::random::Seed;
use crate::shopfront::GroundFloor;
use crate::stage::{Camera, Piece, Show, Stage, film};
use glam::{DMat3, DVec2, DVec3, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// Places of the planes of the street in the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreetTruth {
    /// Image of the street's direction: where its parallel lines meet.
    pub vanishing_point: DVec2,
    /// Maps the ground to the image: x in meters to the right of the street's axis, y in meters away from the camera.
    /// Valid where y is positive.
    pub image_from_ground: DMat3,
    /// The house fronts.
    pub facades: Vec<FacadeTruth>,
}

/// Place of a house front in the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FacadeTruth {
    /// Maps (meters to the right along the front, meters up from the ground, 1) to the image. Serialized column by
    /// column, as are all matrices.
    pub image_from_plane: DMat3,
    /// Width and height to the eaves, meters.
    pub size: DVec2,
    /// For each window of the upper floors its corners in the image (lower left, lower right, upper right, upper left
    /// as seen on the wall). Some lie outside the picture or behind other things.
    pub windows_in_image: Vec<[DVec2; 4]>,
}

/// Left and right house line, meters from the street's axis.
const WALLS: [f64; 2] = [-5.0, 5.6];
const KERBS: [f64; 2] = [-3.1, 3.7];
/// Extent of the ground behind the camera and to the sides, so that it fills the picture.
const GROUND_BEHIND: f64 = 2.0;
const GROUND_ASIDE: f64 = 60.0;

fn camera(size: Size) -> Camera {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    Camera {
        position: DVec3::new(0.75, 1.72, 0.0),
        // a moderate wide angle for any shape of picture
        focal_px: 0.78 * (extent.x * extent.y).sqrt(),
        vanishing_point: extent * DVec2::new(0.475, 0.615),
    }
}

/// The street at any size. The seed moves clouds, leaves, stains, stones and curtains; the houses stay.
pub fn street(size: Size, seed: Seed) -> (Image<LinearRgb>, StreetTruth) {
    let camera = camera(size);
    let stage = stage(seed);
    let truth = truth(&camera, &stage);
    let image = paint_adaptive(size, 3, painter(size, camera, stage));
    (image, truth)
}

/// The color of about a square of a side around a position of the picture.
fn painter(size: Size, camera: Camera, stage: Stage) -> impl Fn(DVec2, f64) -> Vec3 + Sync {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let spread = 1.0 / camera.focal_px;
    move |p, side| {
        let direction = camera.direction(p);
        let light = stage.radiance(camera.position, direction, spread * side);
        // a lens that is a little darker towards its border
        let off = (p - 0.5 * extent).length() / (0.5 * extent.length());
        let vignette = 1.0 - 0.30 * off.powi(3);
        graded(film(light * vignette as f32, 0.60))
    }
}

/// The street's picture as a function of the position.
pub(crate) fn street_painter(size: Size, seed: Seed) -> impl Fn(DVec2, f64) -> Vec3 + Sync {
    painter(size, camera(size), stage(seed))
}

/// Slightly cooler shadows and richer colors.
pub(crate) fn graded(color: Vec3) -> Vec3 {
    let gray = Vec3::splat(color.dot(Vec3::new(0.2126, 0.7152, 0.0722)));
    let rich = gray + (color - gray) * 1.16;
    let shade = (1.0 - gray.x * 2.5).clamp(0.0, 1.0);
    (rich * Vec3::ONE.lerp(Vec3::new(0.93, 0.99, 1.10), shade)).clamp(Vec3::ZERO, Vec3::ONE)
}

fn truth(camera: &Camera, stage: &Stage) -> StreetTruth {
    let mut facades = Vec::new();
    for piece in &stage.pieces {
        let Show::Facade(facade) = &piece.show else {
            continue;
        };
        let corner = |q: DVec2| camera.project(piece.point(q));
        let windows = facade.windows().map(|w| {
            [
                corner(w.low),
                corner(DVec2::new(w.high.x, w.low.y)),
                corner(w.high),
                corner(DVec2::new(w.low.x, w.high.y)),
            ]
        });
        facades.push(FacadeTruth {
            image_from_plane: camera.image_from_piece(piece),
            size: DVec2::new(facade.width, facade.height),
            windows_in_image: windows.collect(),
        });
    }
    let axis = Piece {
        origin: DVec3::ZERO,
        right: DVec3::X,
        up: DVec3::NEG_Z,
        size: DVec2::ONE,
        show: Show::Prop(Box::new(Prop::Panel(Vec3::ONE))),
    };
    StreetTruth {
        vanishing_point: camera.vanishing_point,
        image_from_ground: camera.image_from_piece(&axis),
        facades,
    }
}

pub(crate) struct House {
    pub width: f64,
    height: f64,
    gable: Gable,
    wall: Wall,
    trim: u32,
    shutters: Option<u32>,
    bays: usize,
    /// Color of shop or door, and the shop's name.
    front: (u32, Option<&'static str>),
}

pub(crate) fn left_row() -> Vec<House> {
    vec![
        House {
            width: 10.0,
            height: 9.6,
            gable: Gable::None,
            wall: Wall::Plaster(hex(0xe3b572)),
            trim: 0xeee3cd,
            shutters: Some(0x3d6f78),
            bays: 4,
            front: (0x244a45, Some("BAKERY")),
        },
        House {
            width: 7.0,
            height: 9.3,
            gable: Gable::Pointed(3.0),
            wall: Wall::Timber(hex(0xeedcbd)),
            trim: 0xd8c8a8,
            shutters: None,
            bays: 4,
            front: (0x7c2f26, Some("CAFE RAVEC")),
        },
        House {
            width: 8.0,
            height: 9.4,
            gable: Gable::Stepped(2.6),
            wall: Wall::Brick(hex(0xa9563b)),
            trim: 0xe3d6bb,
            shutters: Some(0x3c5a3c),
            bays: 4,
            front: (0x3a4f6e, None),
        },
        House {
            width: 9.0,
            height: 12.4,
            gable: Gable::None,
            wall: Wall::Plaster(hex(0xd48a6c)),
            trim: 0xecdfc8,
            shutters: Some(0x556a5a),
            bays: 4,
            front: (0x4a2e44, Some("BOOKS")),
        },
        House {
            width: 8.0,
            height: 9.3,
            gable: Gable::Pointed(2.6),
            wall: Wall::Plaster(hex(0xcfc3a0)),
            trim: 0xe9e0cf,
            shutters: Some(0x8a3b30),
            bays: 3,
            front: (0x5b3a24, None),
        },
        House {
            width: 16.0,
            height: 12.3,
            gable: Gable::None,
            wall: Wall::Brick(hex(0xb57a55)),
            trim: 0xe6dcc6,
            shutters: None,
            bays: 6,
            front: (0x3b3b3f, None),
        },
    ]
}

pub(crate) fn right_row() -> Vec<House> {
    vec![
        House {
            width: 9.5,
            height: 9.5,
            gable: Gable::None,
            wall: Wall::Brick(hex(0x985240)),
            trim: 0xe0d3bc,
            shutters: None,
            bays: 4,
            front: (0x2f3f5c, Some("ANTIQUES")),
        },
        House {
            width: 7.5,
            height: 8.2,
            gable: Gable::Stepped(2.0),
            wall: Wall::Plaster(hex(0x9db4c0)),
            trim: 0xeee8dc,
            shutters: Some(0x4b5f7c),
            bays: 3,
            front: (0x6e2723, None),
        },
        // after a gap through which the sun falls
        House {
            width: 8.0,
            height: 9.3,
            gable: Gable::Pointed(2.8),
            wall: Wall::Plaster(hex(0xd9a186)),
            trim: 0xece2d0,
            shutters: Some(0x5c7052),
            bays: 4,
            front: (0x2e554c, Some("FLOWERS")),
        },
        House {
            width: 11.0,
            height: 12.3,
            gable: Gable::None,
            wall: Wall::Plaster(hex(0xd8cda8)),
            trim: 0xeee6d4,
            shutters: Some(0x465966),
            bays: 5,
            front: (0x4a2b22, None),
        },
        House {
            width: 14.0,
            height: 9.6,
            gable: Gable::Pointed(3.0),
            wall: Wall::Brick(hex(0xa06048)),
            trim: 0xe2d6c2,
            shutters: None,
            bays: 6,
            front: (0x35423c, None),
        },
    ]
}

/// Depth at which the rows begin, and the gap after the second house on the right.
const ROW_START: f64 = 3.2;
const GAP: f64 = 5.0;

fn stage(seed: Seed) -> Stage {
    let mut pieces = vec![ground(seed)];
    pieces.extend(houses(seed));
    pieces.extend(church(DVec3::new(-9.0, 0.0, -78.0)));
    pieces.extend(street_furniture(seed));
    let boxes = flower_boxes(&pieces, seed);
    pieces.extend(boxes);
    pieces.extend(buntings(seed));
    let sun = DVec3::new(0.46, 0.78, 0.32);
    Stage::new(pieces, sun, seed.fork(800))
}

/// The pavement and the roadway.
fn ground(seed: Seed) -> Piece {
    Piece {
        origin: DVec3::new(-GROUND_ASIDE, 0.0, GROUND_BEHIND),
        right: DVec3::X,
        up: DVec3::NEG_Z,
        size: DVec2::new(2.0 * GROUND_ASIDE, 400.0),
        show: Show::Prop(Box::new(Prop::Ground {
            middle: GROUND_ASIDE,
            kerbs: KERBS,
            seed: seed.fork(100),
        })),
    }
}

/// A house whose lower left corner is at `origin`.
pub(crate) fn facade(house: &House, origin: DVec3, right: DVec3, seed: Seed) -> Piece {
    let facade = Facade {
        width: house.width,
        height: house.height,
        gable: house.gable,
        wall: house.wall,
        trim: hex(house.trim),
        shutters: house.shutters.map(hex),
        bays: house.bays,
        ground_floor: match house.front {
            (color, Some(name)) => GroundFloor::shop(hex(color), name, house.width),
            (color, None) => GroundFloor::Door(hex(color)),
        },
        seed,
    };
    Piece {
        origin,
        right,
        up: DVec3::Y,
        size: DVec2::new(facade.width, facade.peak()),
        show: Show::Facade(Box::new(facade)),
    }
}

/// Both rows of houses.
fn houses(seed: Seed) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut depth = ROW_START;
    for (index, house) in left_row().into_iter().enumerate() {
        let width = house.width;
        pieces.push(facade(
            &house,
            DVec3::new(WALLS[0], 0.0, -depth),
            DVec3::NEG_Z,
            seed.fork(200 + index as u64),
        ));
        depth += width;
    }
    let mut depth = ROW_START - 1.0;
    let mut corner = depth;
    for (index, house) in right_row().into_iter().enumerate() {
        if index == 2 {
            depth += GAP;
            corner = depth;
        }
        let width = house.width;
        depth += width;
        pieces.push(facade(
            &house,
            DVec3::new(WALLS[1], 0.0, -depth),
            DVec3::Z,
            seed.fork(220 + index as u64),
        ));
    }
    // the sunlit side of the house behind the gap
    pieces.push(Piece {
        origin: DVec3::new(WALLS[1], 0.0, -corner),
        right: DVec3::X,
        up: DVec3::Y,
        size: DVec2::new(14.0, 9.3),
        show: Show::Prop(Box::new(Prop::Bricks(hex(0xb56b4a), seed.fork(300)))),
    });
    pieces
}

/// Awnings, a sign, trees, lamps, a bicycle and pots.
fn street_furniture(seed: Seed) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let wall = WALLS[0];
    pieces.extend(awning(
        DVec3::new(wall, 2.62, -8.4),
        4.6,
        [0xf3eada, 0xb83a2e],
    ));
    pieces.extend(awning(
        DVec3::new(wall, 2.62, -13.9),
        5.6,
        [0xf3eada, 0x2f6b66],
    ));
    pieces.push(hanging_sign(DVec3::new(wall, 3.75, -12.9), "CAFE"));
    for (index, depth) in [16.9, 27.5, 41.0].into_iter().enumerate() {
        pieces.push(tree(
            DVec3::new(-3.75, 0.0, -depth),
            seed.fork(400 + index as u64),
        ));
    }
    for (index, depth) in [21.5, 35.0].into_iter().enumerate() {
        pieces.push(tree(
            DVec3::new(4.6, 0.0, -depth),
            seed.fork(410 + index as u64),
        ));
    }
    for (x, depth) in [
        (3.95, 9.3),
        (-3.4, 13.6),
        (3.95, 18.0),
        (-3.4, 23.0),
        (-3.4, 34.0),
    ] {
        pieces.push(lamp(DVec3::new(x, 0.0, -depth)));
    }
    pieces.push(bicycle(DVec3::new(-4.35, 0.0, -8.6)));
    for (index, (x, depth, blossom)) in [
        (-4.55, 11.4, 0xd83246),
        (-4.5, 13.4, 0xf0c840),
        (4.9, 8.2, 0xe8e2f0),
        (4.9, 10.9, 0xd84a7a),
    ]
    .into_iter()
    .enumerate()
    {
        pieces.push(pot(
            DVec3::new(x, 0.0, -depth),
            blossom,
            seed.fork(500 + index as u64),
        ));
    }
    pieces
}

/// Flower boxes below the windows of three houses.
pub(crate) fn flower_boxes(pieces: &[Piece], seed: Seed) -> Vec<Piece> {
    let mut boxes = Vec::new();
    for piece in pieces.iter().filter(|p| p.origin.z > -22.0) {
        let Show::Facade(facade) = &piece.show else {
            continue;
        };
        if facade.shutters.is_none() && !matches!(facade.wall, Wall::Timber(_)) {
            continue;
        }
        for (index, window) in facade.windows().enumerate() {
            if index < 2 * facade.bays {
                let at = piece.point(DVec2::new(
                    0.5 * (window.low.x + window.high.x),
                    window.low.y,
                ));
                boxes.push(flower_box(
                    at,
                    piece.right,
                    seed.fork(600 + boxes.len() as u64),
                ));
            }
        }
    }
    boxes
}

/// Lines of flags across the street.
fn buntings(seed: Seed) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for (index, (depth, ends, sag)) in [
        (12.2, [1.75, 1.9], 0.75),
        (19.5, [1.6, 1.4], 0.8),
        (29.0, [1.7, 1.5], 0.8),
    ]
    .into_iter()
    .enumerate()
    {
        pieces.push(Piece {
            origin: DVec3::new(WALLS[0], 4.75, -depth),
            right: DVec3::X,
            up: DVec3::Y,
            size: DVec2::new(WALLS[1] - WALLS[0], 2.0),
            show: Show::Prop(Box::new(Prop::Bunting {
                span: WALLS[1] - WALLS[0],
                ends,
                sag,
                seed: seed.fork(700 + index as u64),
            })),
        });
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facade_homographies_map_window_corners_where_the_truth_says() {
        let (_, truth) = street(Size::new(48, 32).unwrap(), Seed(1));
        for facade in &truth.facades {
            // the foot of a wall lies on the ground, and parallel edges meet in the vanishing point
            let far = facade.image_from_plane * DVec3::X;
            assert!((far.truncate() / far.z).distance(truth.vanishing_point) < 1e-9);
            for corners in &facade.windows_in_image {
                let plane_from_image = facade.image_from_plane.inverse();
                let plane = corners
                    .map(|c| plane_from_image * c.extend(1.0))
                    .map(|h| h.truncate() / h.z);
                // windows are axis-parallel rectangles on the wall
                assert!(
                    (plane[0].y - plane[1].y).abs() < 1e-9
                        && (plane[1].x - plane[2].x).abs() < 1e-9
                );
                assert!(
                    (plane[2].y - plane[3].y).abs() < 1e-9
                        && (plane[2].y - plane[1].y - 1.6).abs() < 1e-9
                );
            }
        }
        assert!(
            truth
                .facades
                .iter()
                .map(|f| f.windows_in_image.len())
                .sum::<usize>()
                > 60
        );
    }
}
