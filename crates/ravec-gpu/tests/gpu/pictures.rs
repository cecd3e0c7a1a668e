//! Pictures of the tests.

use ravec_raster::{AnyImage, Image, LinearRgba, Size};
use ravec_scenes::catalog::{SceneId, render};

/// All scenes at some size, in light.
pub fn scenes(width: usize, height: usize) -> impl Iterator<Item = (&'static str, AnyImage)> {
    SceneId::ALL.iter().map(move |&id| {
        let scene = render(id, Size::new(width, height).unwrap(), id.default_seed());
        (id.name(), scene.image)
    })
}

/// Edges, texture and noise in light beyond what the screen shows, with transparency of all kinds.
pub fn glass(width: usize, height: usize) -> Image<LinearRgba> {
    Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        let v = |k: usize| ((col * 37 + row * 91 + col * row * k) % 101) as f32 / 90.0;
        let alpha = match (col / 24 + row / 24) % 4 {
            0 => 1.0,
            1 => (col % 24) as f32 / 23.0,
            2 => v(11).min(1.0),
            _ => f32::from(col % 3 == 0),
        };
        let lift = if col > 2 * row { 0.5 } else { 0.0 };
        LinearRgba([v(3) + lift, v(5), v(7) - 0.1, alpha])
    })
}
