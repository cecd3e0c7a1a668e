//! The picture made of drawn photos, as each tile for itself would have them and as the eye from afar.

use super::Demo;
use crate::error::JobError;
use crate::gallery::Figure;
use ravec::mosaic::{
    ChooseError, ChooseParams, Crop, Frame, Look, MAX_DEGREE, Photos, Rules, choose, grid_tiles,
    near_duplicates, scaled_photo,
};
use ravec::raster::{
    Image, LinearRgb, Oklab, ResizeFilter, Size, Srgb, compare, gaussian_blur, resize,
};
use ravec_scenes::Seed;

/// How many photos are drawn.
const PHOTOS: u64 = 1500;

/// Side of a drawn photo, in pixels.
const PHOTO_PX: usize = 24;

/// Side of a tile, in pixels.
const TILE_PX: usize = 16;

impl Demo<'_> {
    /// Two mosaics from the same photos under the same rules.
    pub(super) fn mosaic(&mut self, seed: Seed) -> Result<(), JobError> {
        self.page.section(
            "Made of photos",
            "Photos are only chosen, scaled and laid side by side; none is recolored, and none is seen twice within 5 tiles. Left, \
             each tile takes the photo that is nearest; right, neighbors make up for one another's errors, as they melt into one \
             another from afar.",
        );
        let (width, height) = (self.size().width(), self.size().height());
        let columns = (width / 12).clamp(1, 64);
        let rows = (columns * height / width).clamp(1, 128);
        let (Ok(size), Ok(tile)) = (
            Size::new(columns * TILE_PX, rows * TILE_PX),
            Size::new(TILE_PX, TILE_PX),
        ) else {
            return Ok(());
        };
        let photos: Vec<Image<Srgb<u8>>> = (0..PHOTOS)
            .map(|number| drawn(number ^ (seed.0 << 32)))
            .collect();
        let looks: Vec<Look> = photos
            .iter()
            .map(|photo| {
                let photo: Image<Oklab> = photo.convert();
                Look::of(&photo, Frame::of(&photo), MAX_DEGREE)
            })
            .collect();
        let picture: Image<Oklab> = self.image.convert();
        let degree = ChooseParams::default().weights.degree;
        let frame = Frame::of(&picture);
        let tiling = grid_tiles(&picture, frame, columns, rows, degree, self.progress)?;
        let groups = near_duplicates(&looks, 0.0, self.progress)?;
        let library = Photos::new(&looks, groups, &ChooseParams::default());
        let truth = resize(
            &self.image.convert::<LinearRgb>(),
            size,
            ResizeFilter::CatmullRom,
        );
        let afar = |image: &Image<LinearRgb>| {
            gaussian_blur(image, TILE_PX as f64 / 2.0).convert::<Srgb<u8>>()
        };
        let truth = afar(&truth);
        let mut figures = Vec::new();
        for (blend, rounds, figure, caption) in [
            (0.0, 0, "mosaic_plain_afar_psnr_db", "each tile for itself"),
            (
                1.0,
                ChooseParams::default().rounds,
                "mosaic_afar_psnr_db",
                "as seen from afar",
            ),
        ] {
            let params = ChooseParams {
                blend,
                rounds,
                ..ChooseParams::default()
            };
            let choice = self.report.time("mosaic", || {
                choose(&tiling, &library, &Rules::default(), &params, self.progress)
            });
            let choice = choice.map_err(|cause| match cause {
                ChooseError::Cancelled(_) => JobError::Cancelled,
                cause => JobError::from_library(ravec_library::LibraryError::Choose(cause)),
            })?;
            let scaled: Vec<Option<Image<Srgb<u8>>>> = choice
                .photos
                .iter()
                .map(|&photo| scaled_photo(&photos[photo as usize], tile, Crop::Never))
                .collect();
            let mosaic = Image::from_fn(size, |col, row| {
                let at = row / TILE_PX * columns + col / TILE_PX;
                let inside = (col % TILE_PX, row % TILE_PX);
                scaled[at]
                    .as_ref()
                    .map_or(Srgb([0; 3]), |photo| photo[inside])
            });
            let psnr = compare(&truth, &afar(&mosaic.convert())).map_or(0.0, |found| found.psnr_db);
            self.report.figures.insert(figure, psnr);
            figures.push(Figure::picture(
                &mosaic.convert(),
                format!("{caption}: {psnr:.1} dB after a blur by half a tile"),
            ));
        }
        self.page.figures(&figures);
        Ok(())
    }
}

/// A small picture: a ground that fades from one color to another, and a disc or a bar.
fn drawn(number: u64) -> Image<Srgb<u8>> {
    let mut state = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678_9abc_def1;
    let mut unit = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut color = |spread: f64| {
        let grey = 255.0 * unit();
        [0, 1, 2].map(|_| (grey + spread * (unit() - 0.5)).clamp(0.0, 255.0))
    };
    let (from, to, shape) = (color(130.0), color(130.0), color(200.0));
    let (turn, fade) = (std::f64::consts::TAU * unit(), unit() * unit());
    let (x0, y0, radius, bar) = (unit(), unit(), 0.1 + 0.3 * unit(), unit() < 0.4);
    let size = Size::new(PHOTO_PX, PHOTO_PX).expect("the side is positive");
    Image::from_fn(size, |col, row| {
        let side = PHOTO_PX as f64;
        let (x, y) = ((col as f64 + 0.5) / side, (row as f64 + 0.5) / side);
        let along = (x - 0.5) * turn.cos() + (y - 0.5) * turn.sin();
        let away = if bar {
            ((x - x0) * turn.cos() + (y - y0) * turn.sin()).abs() - 0.4 * radius
        } else {
            (x - x0).hypot(y - y0) - radius
        };
        let inside = (0.5 - away * side).clamp(0.0, 1.0);
        Srgb([0, 1, 2].map(|i| {
            let ground = from[i] + fade * (0.5 + along) * (to[i] - from[i]);
            (ground + inside * (shape[i] - ground)) as u8
        }))
    })
}
