//! The gallery: one page that shows what two-color pixels, planes and meshes are good for, with pictures, timings and measured
//! figures.
//!
//! [`run`] computes everything while it makes the page, from the built-in street or from a photo, and from solids with formulas.
//! It uses the libraries as any program would, and is the longest example of how they are called.
//!
//! ```
//! use ravec::progress::Progress;
//! use ravec_demo::{Params, run};
//!
//! let folder = tempfile::tempdir()?;
//! let params = Params { max_side: 64, ..Params::default() };
//! let report = run(None, folder.path(), &params, &Progress::none())?;
//! assert!(report.figures["twocolor_psnr_db"] > report.figures["mosaic_psnr_db"]);
//! assert!(folder.path().join("index.html").exists());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Guarantees: the page is one file, which fetches nothing and needs no other; it is written whole or not at all; with equal
//! parameters it differs only in measured times. Does not guarantee: that the page shows every operation.

mod error;
mod formats;
mod page;
mod pictures;
mod planes;
mod solids;

use page::Gallery;
use ravec::progress::Progress;
use ravec::raster::{
    AnyImage, Image, LinearRgba, PremulLinearRgba, ResizeFilter, Size, Srgb, resize,
};
use ravec_jobs::{
    JobError, Report, Source, check_folder, make_folder, read_picture, write_output_text,
};
use ravec_scenes::Seed;
use ravec_scenes::street::street;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of the demonstration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The longest side of the picture that is worked on, 64 to 8192; larger photos are reduced
    ///
    /// Below 640, pictures of meshes are smaller and coarser, too.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().max_side))]
    pub max_side: usize,
    /// Seed of the built-in street and of the added noise
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Params::default().seed))]
    pub seed: u64,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            max_side: 1536,
            seed: 1,
        }
    }
}

/// Makes the page `index.html` in the folder `out`, from a photo or from the built-in street.
///
/// Figures: `twocolor_psnr_db` and `mosaic_psnr_db` at blocks of 8; `clean_psnr_db` and `noisy_psnr_db` at noise of 25 steps;
/// `fit_megapixels_per_second`; `snapped_px`, how far a grid that snapped is off;
/// `simplified_triangles` and `simplified_distance_percent` of a torus;
/// `retargeted_disc_aspect`, how much discs are squeezed when the width is halved;
/// `front_completed_error_steps` and `floor_completed_error_steps` of what was filled in perspective, in 8-bit steps;
/// `mosaic_plain_afar_psnr_db` and `mosaic_afar_psnr_db` of mosaics after a blur by half a tile;
/// `offset_triangles`, `offset_error_percent` (of the tolerance) and `offset_proved` of offsets;
/// `boolean_solid` (0 or 1, whether all results of expressions are) and `boolean_kept_percent` of the triangles of
/// a scan from which a box was taken.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::Read`] for the photo, [`JobError::Write`], [`JobError::Cancelled`].
///
/// # Panics
/// Never: the size of the built-in street follows from a side that was checked.
pub fn run(
    photo: Option<&Source>,
    out: &Path,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    if !(64..=8192).contains(&params.max_side) {
        return Err(JobError::Parameter {
            name: "--max-side",
            value: params.max_side.to_string(),
            range: "64 to 8192",
        });
    }
    check_folder(out)?;
    let mut report = Report::new("demo", params);
    report.seed = Some(params.seed);
    let (image, origin) = if let Some(source) = photo {
        let picture = read_picture(source, &mut report, progress)?;
        (reduced(&picture.image, params.max_side), "the photo")
    } else {
        // three to two; at least 64 pixels wide, as checked above
        let size =
            Size::new(params.max_side, params.max_side * 2 / 3).expect("both sides are positive");
        let phase = progress.phase("draw", 1);
        let image = report.time("draw", || street(size, Seed(params.seed)).0);
        phase.advance(1);
        (image.convert(), "a street drawn by formulas")
    };
    let mut page = Gallery::new(
        "Ravec",
        "The systems of the toolkit at work, on examples that were computed while this page was made. Move the divider of a \
         pair of pictures, and turn the solids with the mouse, a finger or the arrow keys.",
    );
    // eight bits, as a file would have
    let image = image.convert::<Srgb<u8>>().convert();
    pictures::show(&mut page, &mut report, image, origin, params, progress)?;
    let side = params.max_side;
    formats::show(&mut page, &mut report, Seed(params.seed), side, progress)?;
    page.chapter("Planes");
    planes::show(&mut page, &mut report, Seed(params.seed), side, progress)?;
    let detail = solids::Detail::of(side);
    page.chapter("Solids");
    solids::show(&mut page, &mut report, Seed(params.seed), detail, progress)?;
    solids::offsets::show(&mut page, &mut report, detail, progress)?;
    solids::booleans::show(&mut page, &mut report, Seed(params.seed), detail, progress)?;
    let page = page.finish();
    make_folder(out)?;
    write_output_text(&out.join("index.html"), "HTML", &page, &mut report)?;
    Ok(report)
}

/// The picture, reduced if a side is too long.
fn reduced(image: &AnyImage, max_side: usize) -> Image<LinearRgba> {
    let (width, height) = (image.size().width(), image.size().height());
    let image = image.convert::<PremulLinearRgba>();
    let factor = max_side as f64 / width.max(height) as f64;
    if factor >= 1.0 {
        return image.convert();
    }
    let side = |pixels: usize| ((pixels as f64 * factor).round() as usize).max(1);
    match Size::new(side(width), side(height)) {
        Ok(size) => resize(&image, size, ResizeFilter::Lanczos3).convert(),
        Err(_) => image.convert(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_media::{Picture, WriteOptions};

    #[test]
    fn the_page_is_whole_and_its_figures_hold() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            max_side: 240,
            ..Params::default()
        };
        let report = run(None, folder.path(), &params, &Progress::none()).unwrap();
        let html = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
        assert!(html.trim_end().ends_with("</html>"));
        page::tests::assert_well_formed(&html);
        assert!(html.matches("<img").count() > 60);
        assert!(html.matches("class=\"compare").count() > 15);
        assert!(html.matches("class=\"stage").count() > 30);
        assert!(report.figures["twocolor_psnr_db"] > report.figures["mosaic_psnr_db"] + 2.0);
        assert!(report.figures["clean_psnr_db"] > report.figures["noisy_psnr_db"] + 3.0);
        assert!(report.figures["simplified_triangles"] <= 1000.0);
        assert!(report.figures["simplified_distance_percent"] < 1.0);
        assert!(report.figures["front_completed_error_steps"] < 25.0);
        assert!(
            report.figures["mosaic_afar_psnr_db"]
                > report.figures["mosaic_plain_afar_psnr_db"] + 1.0
        );
        assert_eq!(report.figures["offset_proved"], 1.0);
        assert!(report.figures["offset_error_percent"] <= 100.0);
        assert_eq!(report.figures["boolean_solid"], 1.0);
    }

    #[test]
    fn tiny_and_transparent_photos_have_a_page_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("in.png");
        for (width, height, alpha) in [(1, 1, 255u8), (40, 3, 0), (30, 50, 128)] {
            let image = Image::new(
                Size::new(width, height).unwrap(),
                ravec::raster::Srgba([90u8, 80, 70, alpha]),
            );
            ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default())
                .unwrap();
            run(
                Some(&Source::new(&path)),
                folder.path(),
                &Params {
                    max_side: 64,
                    ..Params::default()
                },
                &Progress::none(),
            )
            .unwrap();
            let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
            page::tests::assert_well_formed(&page);
        }
    }

    #[test]
    fn sides_out_of_range_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            max_side: 10,
            ..Params::default()
        };
        assert_eq!(
            run(None, folder.path(), &params, &Progress::none())
                .unwrap_err()
                .exit_code(),
            2
        );
    }
}
