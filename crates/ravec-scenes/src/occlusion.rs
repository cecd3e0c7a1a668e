//! Textured planes with something in front of them: what is hidden is known.
//!
//! A wall or a floor under a known homography, drawn by formulas, once bare and once with a post before it. A method that
//! takes the post away can be held against the bare picture.
//!
//! Plane coordinates: meters, x to the right, y down on walls and towards the viewer on floors.

use crate::paint::{hex, paint_adaptive};
use crate::plane::image_from_unit_square;
use crate::random::Seed;
use crate::texture::{brick, fractal, tiles, wood};
use glam::{DMat3, DVec2, Vec3};
use ravec_raster::{Image, LinearRgb, Mask, Size};

/// Material of the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// A wall of bricks, each of its own color.
    Bricks,
    /// Plaster with rows of equal windows.
    Windows,
    /// Tiles in two colors.
    Tiles,
    /// Planks.
    Wood,
}

impl Surface {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Bricks, Self::Windows, Self::Tiles, Self::Wood];

    /// Width and height of the plane in meters.
    fn extent(self) -> DVec2 {
        match self {
            Self::Bricks => DVec2::new(3.2, 2.4),
            Self::Windows => DVec2::new(24.0, 18.0),
            Self::Tiles => DVec2::new(8.0, 6.0),
            Self::Wood => DVec2::new(2.0, 1.5),
        }
    }

    fn color(self, p: DVec2, footprint: f64, seed: Seed) -> Vec3 {
        match self {
            Self::Bricks => brick(p, footprint, hex(0xa5573e), seed),
            Self::Tiles => tiles(p, footprint, 0.4, [hex(0xd8cdb8), hex(0x8a5f48)], seed),
            Self::Wood => wood(p, footprint, hex(0xb98a5a), seed),
            Self::Windows => {
                let grain = fractal(p / 0.3, footprint / 0.3, 4, seed);
                let cell = DVec2::new(p.x.rem_euclid(3.0), p.y.rem_euclid(3.6));
                let inside = |margin: f64| {
                    let (low, high) =
                        (DVec2::new(0.9, 0.8) - margin, DVec2::new(2.1, 2.6) + margin);
                    cell.cmpgt(low).all() && cell.cmplt(high).all()
                };
                let bar = (cell.x - 1.5).abs() < 0.05 || (cell.y - 1.4).abs() < 0.05;
                if inside(0.0) && !bar {
                    hex(0x3c4a58)
                } else if inside(0.15) {
                    hex(0xf0ece2)
                } else {
                    hex(0xd9b98a) * (1.0 + 0.06 * grain) as f32
                }
            }
        }
    }
}

/// A plane with a post before it, and what the post hides.
#[derive(Debug, Clone)]
pub struct Occlusion {
    /// The picture that the camera takes.
    pub picture: Image<LinearRgb>,
    /// The same without the post.
    pub background: Image<LinearRgb>,
    /// The post, with the pixels that it covers in part.
    pub post: Mask,
    /// The images of the plane's corners, in order around it; they may lie outside the picture.
    pub corners_in_image: [DVec2; 4],
    /// Maps (x, y, 1) on the plane to the image.
    pub image_from_plane: DMat3,
}

/// A plane that fills the picture, seen from the side, with a post before it.
///
/// # Panics
/// Never: the outline of the post follows from the size.
pub fn occluded(surface: Surface, size: Size, seed: Seed) -> Occlusion {
    let end = DVec2::new(size.width() as f64, size.height() as f64);
    let corners = [
        (-0.05, -0.25),
        (1.1, 0.08 * (0.5 + seed.unit(1, 0, 0))),
        (1.05, 0.85),
        (-0.1, 1.3),
    ]
    .map(|(x, y)| end * DVec2::new(x, y));
    let image_from_plane =
        image_from_unit_square(corners) * DMat3::from_scale(surface.extent().recip());
    let plane_from_image = image_from_plane.inverse();
    let on_plane = |p: DVec2| {
        let h = plane_from_image * p.extend(1.0);
        h.truncate() / h.z
    };
    let background = paint_adaptive(size, 4, |p, side| {
        let q = on_plane(p);
        let footprint =
            (on_plane(p + DVec2::X * side) - q).perp_dot(on_plane(p + DVec2::Y * side) - q);
        let grain = fractal(p / end.y * 9.0, 9.0 * side / end.y, 3, seed.fork(2));
        surface.color(q, footprint.abs().sqrt(), seed) * (0.8 + 0.03 * grain) as f32
    });
    let middle = 0.42 + 0.1 * seed.unit(2, 0, 0);
    let outline = [(-0.025, 0.3), (0.025, 0.3), (0.035, 0.75), (-0.035, 0.75)]
        .map(|(x, y)| end * DVec2::new(middle + x, y));
    let head = end * DVec2::new(middle, 0.28);
    let pole = Mask::from_polygon(size, &outline).expect("corners within a picture");
    let lamp = Mask::from_disc(size, head, 0.06 * end.y).expect("a place within a picture");
    let post = pole.union(&lamp).expect("masks of one size");
    let picture = Image::from_fn(size, |col, row| {
        let share = post.at(col, row);
        let paint = [0.02f32, 0.03, 0.03];
        let LinearRgb(behind) = background[(col, row)];
        LinearRgb([0, 1, 2].map(|c| behind[c] + share * (paint[c] - behind[c])))
    });
    Occlusion {
        picture,
        background,
        post,
        corners_in_image: corners,
        image_from_plane,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_is_the_background_but_for_the_post() {
        let size = Size::new(120, 90).unwrap();
        for surface in Surface::ALL {
            let scene = occluded(surface, size, Seed(3));
            assert!(scene.post.area_px() > 100.0);
            for row in 0..90 {
                for col in 0..120 {
                    let same = scene.picture[(col, row)] == scene.background[(col, row)];
                    assert!(
                        same || scene.post.at(col, row) > 0.0,
                        "{surface:?} {col} {row}"
                    );
                }
            }
        }
    }

    #[test]
    fn corners_of_the_plane_are_where_they_are_said_to_be() {
        let scene = occluded(Surface::Tiles, Size::new(120, 90).unwrap(), Seed(1));
        let h = scene.image_from_plane * Surface::Tiles.extent().extend(1.0);
        assert!((h.truncate() / h.z).distance(scene.corners_in_image[2]) < 1e-9);
    }
}
