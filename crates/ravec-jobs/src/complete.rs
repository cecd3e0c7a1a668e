//! `complete`: holes of a picture filled from the rest of it, in perspective where planes are known.

use crate::error::JobError;
use crate::files::{self, Source};
use crate::report::Report;
use glam::DVec2;
use ravec::completion::{CompleteError, CompleteParams, CompleteSummary, complete};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Color, Image, Mask, Plane, Size, Srgba, with_image};
use ravec_media::WriteOptions;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::str::FromStr;

/// What is filled, and from where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The corners x0,y0,x1,y1,x2,y2,x3,y3 of a rectangle on a plane, in order around it; `none` or nothing for no plane.
    /// May be repeated
    ///
    /// The part of the hole in it is filled in its perspective. Where several overlap, the first one counts.
    #[cfg_attr(
        feature = "cli",
        arg(long = "plane", value_name = "X0,Y0,...", allow_hyphen_values = true)
    )]
    pub planes: Vec<Corners>,
    /// The corners x0,y0,x1,y1,x2,y2,... of a polygon that is replaced as well. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(long = "polygon", value_name = "X0,Y0,...", allow_hyphen_values = true)
    )]
    pub polygons: Vec<Corners>,
    /// How far from the hole sources are looked for where there is no plane, in pixels, 16 to 65535. Farther finds more, of
    /// which more is in another light
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Self::default().search))]
    pub search: u16,
    /// Keep the tones of what is copied, instead of bending them to those around the hole
    #[cfg_attr(feature = "cli", arg(long))]
    pub unblended: bool,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Self::default().quality))]
    pub quality: u8,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            planes: Vec::new(),
            polygons: Vec::new(),
            search: CompleteParams::default().search_px as u16,
            unblended: false,
            quality: WriteOptions::default().quality,
        }
    }
}

/// Corners as they are given on the command line: x and y in turn, in pixels, x right, y down, pixel centres at
/// half-integers. None at all for `none` or an empty text.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Corners(pub Vec<DVec2>);

impl FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.is_empty() || text == "none" {
            return Ok(Self::default());
        }
        let number = |word: &str| match word.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("`{}` is not a number", word.trim())),
        };
        let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
        if numbers.len() % 2 == 1 {
            return Err(format!(
                "{} numbers are not pairs of x and y",
                numbers.len()
            ));
        }
        Ok(Self(
            numbers
                .chunks_exact(2)
                .map(|pair| DVec2::new(pair[0], pair[1]))
                .collect(),
        ))
    }
}

impl Params {
    fn check(&self, mask: Option<&Source>) -> Result<(), JobError> {
        let wrong = |name, value: String, range| Err(JobError::Parameter { name, value, range });
        if mask.is_none() && self.polygons.iter().all(|polygon| polygon.0.is_empty()) {
            return wrong(
                "--mask or --polygon",
                "missing".to_owned(),
                "what is to be replaced",
            );
        }
        if let Some(plane) = self
            .planes
            .iter()
            .find(|plane| !matches!(plane.0.len(), 0 | 4))
        {
            return wrong(
                "--plane",
                format!("{} corners", plane.0.len()),
                "4 corners, that is 8 numbers",
            );
        }
        if let Some(polygon) = self
            .polygons
            .iter()
            .find(|polygon| matches!(polygon.0.len(), 1 | 2))
        {
            return wrong(
                "--polygon",
                format!("{} corners", polygon.0.len()),
                "3 corners or more",
            );
        }
        if self.search < 16 {
            return wrong("--search", self.search.to_string(), "16 to 65535");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("--quality", self.quality.to_string(), "1 to 100");
        }
        Ok(())
    }
}

/// Replaces what the mask (white replaces, black keeps, grey mixes) and the polygons cover.
///
/// Figures: `hole_px`, pixels that were replaced, be it in part; of these `thin_px`, interpolated because they were near
/// known ones on both sides, and `plane_px`, filled along planes; `parts` that were filled one after another; `proposals`
/// and `offsets`, places that were thought of and that were copied from; `sourceless_px`, pixels without any source.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::Read`], [`JobError::SizesDiffer`], [`JobError::Complete`], [`JobError::Write`], what
/// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
pub fn run(
    input: &Source,
    mask: Option<&Source>,
    output: &Path,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    params.check(mask)?;
    files::check_target(output)?;
    let inputs: Vec<&Path> = std::iter::once(input)
        .chain(mask)
        .map(|source| source.path.as_path())
        .collect();
    files::check_files(&inputs, &[output])?;
    let mut report = Report::new("complete", params);
    let picture = files::read(input, &mut report, progress)?;
    let size = picture.image.size();
    files::check_size(output, size, &picture)?;
    let mut hole = match mask {
        Some(source) => {
            let mask = files::read(source, &mut report, progress)?.image;
            if mask.size() != size {
                return Err(JobError::SizesDiffer {
                    a: input.path.clone(),
                    a_size: size,
                    b: source.path.clone(),
                    b_size: mask.size(),
                });
            }
            coverage(&mask)
        }
        None => Mask::empty(size),
    };
    add_polygons(&mut hole, size, params)?;
    let planes: Vec<[DVec2; 4]> = params
        .planes
        .iter()
        .filter_map(|plane| plane.0.as_slice().try_into().ok())
        .collect();
    let options = CompleteParams {
        search_px: usize::from(params.search),
        blend: !params.unblended,
    };
    let filled = report.time(
        "complete",
        || with_image!(&picture.image, image => filled(image, &hole, &planes, &options, progress)),
    );
    let (image, summary) = filled.map_err(|cause| JobError::from_completing(&input.path, cause))?;
    if summary.hole_px == 0 {
        report.warn("the mask is empty: the picture is as it was");
    }
    for (index, _) in summary
        .plane_px
        .iter()
        .enumerate()
        .filter(|(_, px)| **px == 0 && summary.hole_px > 0)
    {
        report.warn(format!("nothing of the mask lies in plane {}", index + 1));
    }
    if summary.sourceless_px > 0 {
        report.warn(format!(
            "{} pixels had no source and were interpolated",
            summary.sourceless_px
        ));
    }
    let options = WriteOptions {
        quality: params.quality,
        ..WriteOptions::default()
    };
    files::write(
        output,
        &picture.with_pixels(image),
        &options,
        &mut report,
        progress,
    )?;
    for (name, count) in [
        ("hole_px", summary.hole_px),
        ("thin_px", summary.thin_px),
        ("plane_px", summary.plane_px.iter().sum()),
        ("parts", summary.parts),
        ("proposals", summary.proposals),
        ("offsets", summary.offsets),
        ("sourceless_px", summary.sourceless_px),
    ] {
        report.figures.insert(name, count as f64);
    }
    Ok(report)
}

fn filled<P: Color>(
    image: &Image<P>,
    hole: &Mask,
    planes: &[[DVec2; 4]],
    params: &CompleteParams,
    progress: &Progress,
) -> Result<(AnyImage, CompleteSummary), CompleteError>
where
    Image<P>: Into<AnyImage>,
{
    let completed = complete(image, hole, planes, params, progress)?;
    Ok((completed.image.into(), completed.summary))
}

/// How white a mask is: encoded values, as one sees them, times alpha.
fn coverage(mask: &AnyImage) -> Mask {
    let values: Image<Srgba<f32>> = mask.convert();
    let plane: Plane =
        values.map(|Srgba([r, g, b, alpha])| alpha * (0.299 * r + 0.587 * g + 0.114 * b));
    // white is white in spite of rounding, and black black
    Mask::from_coverage(&plane.map(|value| (value * 65535.0).round() / 65535.0))
}

fn add_polygons(hole: &mut Mask, size: Size, params: &Params) -> Result<(), JobError> {
    for polygon in params
        .polygons
        .iter()
        .filter(|polygon| !polygon.0.is_empty())
    {
        let wrong = |_| JobError::Parameter {
            name: "--polygon",
            value: "too large".to_owned(),
            range: "coordinates between -1e9 and 1e9",
        };
        let covered = Mask::from_polygon(size, &polygon.0).map_err(wrong)?;
        *hole = hole.union(&covered).map_err(wrong)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{Rect, Srgb};
    use ravec_media::Picture;

    fn tile(col: usize, row: usize) -> Srgb<u8> {
        Srgb(if col % 16 < 2 || row % 12 < 2 {
            [210, 205, 190]
        } else {
            [100, 60, 50]
        })
    }

    fn write(folder: &Path, name: &str, image: impl Into<AnyImage>) -> Source {
        let path = folder.join(name);
        ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
        Source::new(path)
    }

    fn folder() -> (tempfile::TempDir, Source, Source, Size) {
        let folder = tempfile::tempdir().unwrap();
        let size = Size::new(96, 72).unwrap();
        let hole = Rect::new(40, 30, 18, 16);
        let stained = Image::from_fn(size, |col, row| {
            if hole.contains(col, row) {
                Srgb([0, 0, 0])
            } else {
                tile(col, row)
            }
        });
        let mask = Image::from_fn(size, |col, row| {
            Srgb([255 * u8::from(hole.contains(col, row)); 3])
        });
        let (input, mask) = (
            write(folder.path(), "in.png", stained),
            write(folder.path(), "mask.png", mask),
        );
        (folder, input, mask, size)
    }

    #[test]
    fn a_stain_on_tiles_goes_and_the_report_says_how() {
        let (folder, input, mask, _) = folder();
        let output = folder.path().join("out.png");
        let report = run(
            &input,
            Some(&mask),
            &output,
            &Params::default(),
            &Progress::none(),
        )
        .unwrap();
        assert_eq!(report.figures["hole_px"], 18.0 * 16.0);
        assert!(report.figures["offsets"] >= 1.0 && report.warnings.is_empty());
        let found = ravec_media::read(&output, &input.limits)
            .unwrap()
            .image
            .convert::<Srgb<u8>>();
        let off = (0..96 * 72).filter(|index| {
            let (col, row) = (index % 96, index / 96);
            found[(col, row)].0[0].abs_diff(tile(col, row).0[0]) > 8
        });
        // seams cost a pixel here and there
        assert!(off.count() < 9);
    }

    #[test]
    fn an_empty_mask_gives_the_picture_back_with_a_note() {
        let (folder, input, _, size) = folder();
        let mask = write(folder.path(), "black.png", Image::new(size, Srgb([0u8; 3])));
        let output = folder.path().join("out.png");
        let report = run(
            &input,
            Some(&mask),
            &output,
            &Params::default(),
            &Progress::none(),
        )
        .unwrap();
        assert_eq!(
            report.warnings,
            ["the mask is empty: the picture is as it was"]
        );
        let image = |path: &Path| ravec_media::read(path, &input.limits).unwrap().image;
        assert_eq!(image(&output), image(&input.path));
    }

    #[test]
    fn what_cannot_be_done_has_its_sentence_and_its_code() {
        let (folder, input, mask, size) = folder();
        let output = folder.path().join("out.png");
        let small = write(
            folder.path(),
            "small.png",
            Image::new(Size::new(9, 9).unwrap(), Srgb([0u8; 3])),
        );
        let white = write(
            folder.path(),
            "white.png",
            Image::new(size, Srgb([255u8; 3])),
        );
        let plane = |text: &str| Params {
            planes: vec![text.parse().unwrap()],
            ..Params::default()
        };
        for (mask, params, code, part) in [
            (Some(&small), Params::default(), 3, "96 x 72"),
            (Some(&white), Params::default(), 3, "radius of 0.0 pixels"),
            (None, Params::default(), 2, "--mask or --polygon"),
            (
                Some(&mask),
                plane("0,0,90,70,90,0,0,70"),
                2,
                "crosses itself",
            ),
            (Some(&mask), plane("0,0,90,0,20,15,0,70"), 2, "horizon"),
            (
                Some(&mask),
                plane("500,0,590,0,590,70,500,70"),
                2,
                "outside",
            ),
            (Some(&mask), plane("0,0,90,0"), 2, "4 corners"),
            (
                Some(&mask),
                Params {
                    search: 1,
                    ..Params::default()
                },
                2,
                "--search",
            ),
        ] {
            let error = run(&input, mask, &output, &params, &Progress::none()).unwrap_err();
            assert_eq!(error.exit_code(), code, "{error}");
            assert!(error.to_string().contains(part), "{error}");
        }
        assert!(!output.exists());
    }

    #[test]
    fn corners_are_pairs_of_numbers_or_none() {
        let corners = |text: &str| text.parse::<Corners>();
        assert_eq!(corners("none"), Ok(Corners::default()));
        assert_eq!(corners(""), Ok(Corners::default()));
        assert_eq!(
            corners("1, 2.5,-3,4").unwrap().0,
            [DVec2::new(1.0, 2.5), DVec2::new(-3.0, 4.0)]
        );
        for wrong in ["1", "1,2,3", "1,x", "nan,1", "1,,2,3"] {
            assert!(corners(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_polygon_is_a_mask_as_well() {
        let (folder, input, _, _) = folder();
        let params = Params {
            polygons: vec!["40,30,58,30,58,46,40,46".parse().unwrap()],
            ..Params::default()
        };
        let output = folder.path().join("out.png");
        let report = run(&input, None, &output, &params, &Progress::none()).unwrap();
        assert_eq!(report.figures["hole_px"], 18.0 * 16.0);
    }
}
