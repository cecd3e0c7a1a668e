//! The gallery: one page that shows what two-color pixels, planes and meshes are good for, with pictures, timings and measured
//! figures.
//!
//! [`Demo`] computes everything while it makes the page, from the built-in street or from a photo, and from solids with formulas.
//! It uses the libraries as any program would, and is the longest example of how they are called.
//!
//! ```
//! use ravec_demo::{Demo, Params};
//! use ravec_jobs::{Context, Operation as _};
//!
//! let folder = tempfile::tempdir()?;
//! let params = Params { max_side: 64, ..Params::default() };
//! let demo = Demo { image: None, out: folder.path().into(), params };
//! let report = demo.run(&Context::default())?;
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
use ravec::raster::{
    AnyImage, Image, LinearRgba, PremulLinearRgba, ResizeFilter, Size, Srgb, resize,
};
use ravec_jobs::{
    Context, JobError, Operation, Report, check_files, check_folder, make_folder, read_picture,
    write_output_text,
};
use ravec_scenes::Seed;
use ravec_scenes::street::street;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Run every system on built-in scenes or a photo, and write a page with the results
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Demo {
    /// A photo to use instead of the built-in street; `-` is standard input
    #[cfg_attr(feature = "cli", arg(long, value_name = "PHOTO"))]
    #[serde(default)]
    pub image: Option<PathBuf>,
    /// Output folder; created if it is missing
    #[cfg_attr(
        feature = "cli",
        arg(short, long, value_name = "DIR", default_value = "ravec-demo")
    )]
    pub out: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec demo
  ravec demo --image photo.jpg --out gallery

Open index.html in the folder with a browser; it needs no other file.";

/// Parameters of [`Demo`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
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

impl Operation for Demo {
    const NAME: &'static str = "demo";

    fn inputs(&self) -> Vec<&Path> {
        self.image.as_deref().into_iter().collect()
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn folders(&self) -> Vec<&Path> {
        vec![&self.out]
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
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { image, out, params } = self;
        let progress = &context.progress;
        if !(64..=8192).contains(&params.max_side) {
            return Err(JobError::Parameter {
                field: "max_side",
                value: params.max_side.to_string(),
                range: "64 to 8192",
            });
        }
        check_files(&self.inputs(), &[])?;
        check_folder(out)?;
        let mut report = Report::of(self, params);
        report.seed = Some(params.seed);
        let (image, origin) = if let Some(photo) = image {
            let picture = read_picture(photo, &mut report, context)?;
            (reduced(&picture.image, params.max_side), "the photo")
        } else {
            // three to two; at least 64 pixels wide, as checked above
            let size = Size::new(params.max_side, params.max_side * 2 / 3)
                .expect("both sides are positive");
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
        write_output_text(&out.join("index.html"), "HTML", &page, &mut report, context)?;
        Ok(report)
    }
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

    fn demo(image: Option<&Path>, out: &Path, params: Params) -> Result<Report, JobError> {
        let demo = Demo {
            image: image.map(Path::to_path_buf),
            out: out.to_path_buf(),
            params,
        };
        demo.run(&Context::default())
    }

    #[test]
    fn the_page_is_whole_and_its_figures_hold() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            max_side: 240,
            ..Params::default()
        };
        let report = demo(None, folder.path(), params).unwrap();
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
            let params = Params {
                max_side: 64,
                ..Params::default()
            };
            demo(Some(&path), folder.path(), params).unwrap();
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
            demo(None, folder.path(), params).unwrap_err().kind(),
            ravec_jobs::ErrorKind::Request
        );
    }
}
