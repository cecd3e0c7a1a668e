//! The picture made of drawn photos: each tile for itself, as the eye sees it from afar, with tiles with an edge in their own
//! way, and off the grid.

use super::Demo;
use crate::error::bug;
use crate::page::Figure;
use ravec::mosaic::{
    ChooseError, ChooseParams, Crop, Descriptor, Features, Frame, MAX_DEGREE, Photos, Rules,
    Tiling, adaptive_tiles, choose, grid_tiles, mark_features, near_duplicates, scaled_photo,
};
use ravec::raster::{
    Image, LinearRgb, Oklab, ResizeFilter, Size, Srgb, compare, gaussian_blur, resize,
};
use ravec_jobs::JobError;
use ravec_scenes::Seed;

/// The number of drawn photos.
const PHOTOS: u64 = 1000;

/// Side of a drawn photo, in pixels.
const PHOTO_PX: usize = 32;

/// Side of a tile of common size, in pixels; a multiple of 3, so that tiles off the grid have whole pixels.
const TILE_PX: usize = 12;

/// Photos and what they look like.
struct Library {
    photos: Vec<Image<Srgb<u8>>>,
    descriptors: Vec<Descriptor>,
    groups: Vec<u32>,
}

impl Demo<'_> {
    /// Four mosaics from the same photos under the same rules.
    pub fn mosaic(&mut self, seed: Seed) -> Result<(), JobError> {
        self.page.section(
            "Photo mosaics",
            "The picture made of other pictures: a thousand drawn photos are only chosen, scaled and laid side by side. None is \
             recolored, and none is seen twice within 5 tiles. Step back to judge them: what counts is the view from afar, \
             measured after a blur by half a tile.",
        );
        let (width, height) = (self.size().width(), self.size().height());
        let columns = (width / 20).clamp(1, 40);
        let rows = (columns * height / width).clamp(1, 96);
        let Ok(size) = Size::new(columns * TILE_PX, rows * TILE_PX) else {
            return Ok(());
        };
        let library = self.library(seed)?;
        let picture: Image<Oklab> = self.image.convert();
        let frame = Frame::of(&picture);
        let whole = Photos::new(
            &library.descriptors,
            library.groups.clone(),
            &ChooseParams::default(),
        );
        let mut grid = grid_tiles(&picture, frame, columns, rows, MAX_DEGREE, self.progress)?;
        mark_features(&picture, frame, &mut grid, self.progress)?;
        let (sides, degree) = ([columns, rows], MAX_DEGREE);
        let free = self.report.time("mosaic", || {
            adaptive_tiles(
                &picture,
                frame,
                sides,
                degree,
                &whole,
                &Rules::default(),
                &ChooseParams::default(),
                seed.0,
                self.progress,
            )
        })?;
        let afar = |image: &Image<LinearRgb>| {
            gaussian_blur(image, TILE_PX as f64 / 2.0).convert::<Srgb<u8>>()
        };
        let light = self.image.convert::<LinearRgb>();
        let truth = afar(&resize(&light, size, ResizeFilter::CatmullRom));
        let plain = ChooseParams {
            blend: 0.0,
            rounds: 0,
            ..ChooseParams::default()
        };
        let features = ChooseParams {
            features: Some(Features {
                degree: MAX_DEGREE,
                weight: 1.0,
            }),
            ..ChooseParams::default()
        };
        let mut figures = Vec::new();
        for (tiling, params, figure, caption) in [
            (
                &grid,
                plain,
                "mosaic_plain_afar_psnr_db",
                "Each tile takes the photo that is nearest to it",
            ),
            (
                &grid,
                ChooseParams::default(),
                "mosaic_afar_psnr_db",
                "Neighbors make up for one another's errors, as they melt into one another from afar",
            ),
            (
                &grid,
                features,
                "mosaic_features_afar_psnr_db",
                "Tiles with an edge are compared by their structure as well",
            ),
            (
                &free,
                ChooseParams::default(),
                "mosaic_adaptive_afar_psnr_db",
                "The same number of tiles off the grid: larger where the picture is even, smaller where it is not",
            ),
        ] {
            let mosaic = self.painted(&library, tiling, &params, size)?;
            let psnr = compare(&truth, &afar(&mosaic.convert())).map_or(0.0, |found| found.psnr_db);
            self.report.figures.insert(figure, psnr);
            let shown = Figure::picture(&mosaic.convert(), caption);
            figures.push(shown.with_note(format!("PSNR {psnr:.1} dB from afar")));
        }
        self.page.figures(&figures);
        Ok(())
    }

    fn library(&self, seed: Seed) -> Result<Library, JobError> {
        let photos: Vec<Image<Srgb<u8>>> = (0..PHOTOS)
            .map(|number| drawn(number ^ (seed.0 << 32)))
            .collect();
        let descriptors: Vec<Descriptor> = photos
            .iter()
            .map(|photo| {
                let photo: Image<Oklab> = photo.convert();
                Descriptor::of(&photo, Frame::of(&photo), MAX_DEGREE)
            })
            .collect();
        let groups = near_duplicates(&descriptors, 0.0, self.progress)?;
        Ok(Library {
            photos,
            descriptors,
            groups,
        })
    }

    /// The mosaic with the photos that are chosen for a tiling.
    fn painted(
        &mut self,
        library: &Library,
        tiling: &Tiling,
        params: &ChooseParams,
        size: Size,
    ) -> Result<Image<Srgb<u8>>, JobError> {
        let choice = self.report.time("mosaic", || {
            let photos = Photos::new(&library.descriptors, library.groups.clone(), params);
            choose(tiling, &photos, &Rules::default(), params, self.progress)
        });
        let choice = choice.map_err(|cause| match cause {
            ChooseError::Cancelled(_) => JobError::Cancelled,
            other => bug("the choice of photos", &other),
        })?;
        let mut mosaic = Image::new(size, Srgb([0; 3]));
        for (tile, &photo) in tiling.tiles.iter().zip(&choice.photos) {
            let px = |units: usize| units * TILE_PX / tiling.units;
            let side = Size::new(px(tile.side), px(tile.side)).ok();
            let photo = &library.photos[photo as usize];
            let scaled = side.and_then(|side| scaled_photo(photo, side, Crop::Never));
            for (row, line) in (px(tile.row)..).zip(scaled.iter().flat_map(Image::rows)) {
                mosaic.row_mut(row)[px(tile.col)..][..line.len()].copy_from_slice(line);
            }
        }
        Ok(mosaic)
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
        let gray = 255.0 * unit();
        [0, 1, 2].map(|_| (gray + spread * (unit() - 0.5)).clamp(0.0, 255.0))
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
