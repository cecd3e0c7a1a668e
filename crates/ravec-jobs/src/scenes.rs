//! `scenes`: writes procedural pictures together with what is known about them.
//!
//! Each scene gives a picture, `NAME.png` (or `NAME.jpg`), and its truth in image coordinates, `NAME.json`. The truth is
//! what the picture was drawn from, so that a method can be judged without photos and without marking anything by hand.
//! A clip gives a folder: `NAME/frame_00000.png` and so on, and `NAME/truth.json`.
//!
//! Guarantees: equal parameters give equal files on any number of threads; each file is whole; memory does not grow with the
//! length of a clip, but for a line about each file in the report. Does not guarantee: that a cancellation takes effect
//! before the scene, the plane of the clip or the frame at hand is drawn, nor that it removes finished files.

mod clips;
mod subject;

pub use subject::{Subject, UnknownScene};

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::report::Report;
use ravec::raster::{AnyImage, Size, Srgb, Srgba};
use ravec_media::{Picture, WriteOptions};
use ravec_scenes::Seed;
use ravec_scenes::catalog::{Scene, SceneId, render};
use ravec_scenes::clip::ClipId;
use ravec_scenes::damage::add_gaussian_noise;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Write procedural pictures with their ground truth
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Scenes {
    /// Output folder; created if it is missing
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "DIR"))]
    pub out: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec scenes --out scenes --width 96 --height 64
  ravec scenes --out noisy --scene disc --scene wedge --noise-sigma 10
  ravec scenes --out damaged --scene line-art --width 320 --height 240 --jpeg 30
  ravec scenes --out clips --scene still-disc --width 160 --height 90 --frames 12 --alpha --plate

Each scene is a picture NAME.png (or NAME.jpg) and NAME.json, which says what it was drawn from.
A clip is a folder NAME with frame_00000.png, frame_00001.png and so on, and truth.json: for each frame the homography of
the background, the lines, discs and rectangles on it, the outlines of the moving shapes and the light; and the cuts.";

/// Parameters of [`Scenes`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Write only this scene or clip; may be given several times [default: all scenes, no clips]
    #[cfg_attr(feature = "cli", arg(long = "scene", value_name = "NAME", value_parser = by_name()))]
    pub scenes: Vec<Subject>,
    /// Columns, 16 to 8192 [default: what suits the scene]
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX"))]
    pub width: Option<u32>,
    /// Rows, 16 to 8192 [default: what suits the scene]
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX"))]
    pub height: Option<u32>,
    /// Seed of the details: another number gives other details of the same kind
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Params::default().seed))]
    pub seed: u64,
    /// Add Gaussian noise of this standard deviation in 8-bit steps, 0 to 255, to scenes without transparency
    #[cfg_attr(feature = "cli", arg(long, value_name = "STEPS", default_value_t = Params::default().noise_sigma))]
    pub noise_sigma: f64,
    /// Frames of a clip, 1 to 100000 [default: 50, which is two seconds]
    #[cfg_attr(feature = "cli", arg(long, value_name = "COUNT"))]
    pub frames: Option<u32>,
    /// Also write the alpha of a clip's moving shapes, into the folder NAME/alpha: white where a shape covers the pixel
    #[cfg_attr(feature = "cli", arg(long))]
    pub alpha: bool,
    /// Also write a clip's frames without moving shapes and without noise, into the folder NAME/plate
    #[cfg_attr(feature = "cli", arg(long))]
    pub plate: bool,
    /// Write JPEG files of this quality, 1 to 100, instead of lossless PNG: lower shows more damage
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY"))]
    pub jpeg: Option<u8>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            scenes: Vec::new(),
            width: None,
            height: None,
            seed: 1,
            noise_sigma: 0.0,
            frames: None,
            alpha: false,
            plate: false,
            jpeg: None,
        }
    }
}

/// Names as flag values, so that help and completions list them.
#[cfg(feature = "cli")]
fn by_name() -> impl clap::builder::TypedValueParser<Value = Subject> {
    use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser as _};
    let names = Subject::all()
        .map(|subject| PossibleValue::new(subject.name()).help(subject.description()));
    PossibleValuesParser::new(names).try_map(Subject::try_from)
}

/// The longest side: the street alone needs minutes there.
const MAX_SIDE_PX: u32 = 8192;
/// The shortest side: below, the shapes are thinner than a pixel.
const MIN_SIDE_PX: u32 = 16;
/// The most frames: more than an hour of film.
const MAX_FRAMES: u32 = 100_000;

impl Params {
    fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: String, range| JobError::Parameter {
            field,
            value,
            range,
        };
        for (name, side) in [("width", self.width), ("height", self.height)] {
            if let Some(side) = side.filter(|side| !(MIN_SIDE_PX..=MAX_SIDE_PX).contains(side)) {
                return Err(wrong(name, side.to_string(), "16 to 8192"));
            }
        }
        if !(0.0..=255.0).contains(&self.noise_sigma) {
            return Err(wrong(
                "noise_sigma",
                self.noise_sigma.to_string(),
                "0 to 255",
            ));
        }
        if let Some(frames) = self.frames.filter(|n| !(1..=MAX_FRAMES).contains(n)) {
            return Err(wrong("frames", frames.to_string(), "1 to 100000"));
        }
        match self.jpeg {
            Some(quality) if !(1..=100).contains(&quality) => {
                Err(wrong("jpeg", quality.to_string(), "1 to 100"))
            }
            _ => Ok(()),
        }
    }

    fn size_of(&self, subject: Subject) -> Size {
        let default = subject.default_size();
        let side = |asked: Option<u32>, default| asked.map_or(default, |side| side as usize);
        let (width, height) = (
            side(self.width, default.width()),
            side(self.height, default.height()),
        );
        Size::new(width, height).expect("`check` passed both sides")
    }

    fn frames_of(&self, id: ClipId) -> usize {
        self.frames
            .map_or(id.default_frames(), |frames| frames as usize)
    }
}

impl Operation for Scenes {
    const NAME: &'static str = "scenes";

    fn inputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn folders(&self) -> Vec<&Path> {
        vec![&self.out]
    }

    /// Draws the scenes into the folder `out`.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for a parameter out of range, [`JobError::Write`] if a file cannot be written,
    /// [`JobError::Cancelled`] between two scenes.
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { out, params } = self;
        let progress = &context.progress;
        params.check()?;
        context.check_is_file(out)?;
        files::check_folder(out)?;
        let subjects: Vec<Subject> = if params.scenes.is_empty() {
            SceneId::ALL.map(Subject::Scene).to_vec()
        } else {
            params.scenes.clone()
        };
        let mut report = Report::of(self, params);
        report.seed = Some(params.seed);
        progress.check()?;
        files::make_folder(out)?;
        let pictures = |subject: &Subject| match subject {
            Subject::Scene(_) => 1,
            Subject::Clip(id) => params.frames_of(*id) as u64,
        };
        let phase = progress.phase("draw", subjects.iter().map(pictures).sum());
        for subject in subjects {
            progress.check()?;
            tracing::info!("drawing {}", subject.name());
            match subject {
                Subject::Scene(id) => {
                    self.write_scene(id, &mut report, context)?;
                    phase.advance(1);
                }
                Subject::Clip(id) => self.write_clip(id, &phase, &mut report, context)?,
            }
        }
        Ok(report)
    }
}

impl Scenes {
    /// Options of the files, and their extension.
    fn options(&self) -> (WriteOptions, &'static str) {
        let default = WriteOptions::default();
        let jpeg = self.params.jpeg;
        let options = WriteOptions {
            quality: jpeg.unwrap_or(default.quality),
            ..default
        };
        (options, if jpeg.is_some() { "jpg" } else { "png" })
    }

    fn write_scene(
        &self,
        id: SceneId,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let Self { out, params } = self;
        let (options, extension) = self.options();
        let size = params.size_of(Subject::Scene(id));
        let scene = report.time("draw", || render(id, size, Seed(params.seed)));
        let image = as_stored(&scene, params.noise_sigma);
        let path = out.join(scene.name).with_extension(extension);
        let picture = Picture::from_image(image);
        files::write(&path, &picture, &options, report, context)?;
        let truth = serde_json::json!({
            "scene": scene.name,
            "width": size.width(),
            "height": size.height(),
            "seed": params.seed,
            "truth": scene.truth,
        });
        let path = out.join(scene.name).with_extension("json");
        files::write_output_text(&path, "JSON", &format!("{truth:#}\n"), report, context)
    }
}

/// The scene in 8 bit, with noise if it is opaque.
fn as_stored(scene: &Scene, noise_sigma: f64) -> AnyImage {
    if scene.image.has_alpha() {
        return scene.image.convert::<Srgba<u8>>().into();
    }
    let image = scene.image.convert::<Srgb<u8>>();
    if noise_sigma > 0.0 {
        // not the seed itself: the noise must have nothing to do with the picture
        add_gaussian_noise(&image, noise_sigma, scene.seed.fork(1)).into()
    } else {
        image.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use ravec::raster::Image;
    use ravec_scenes::catalog::Truth;
    use ravec_scenes::clip::{ClipTruth, clip};

    fn run(out: &Path, params: &Params) -> Result<Report, JobError> {
        let operation = Scenes {
            out: out.to_path_buf(),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    fn small() -> Params {
        Params {
            width: Some(48),
            height: Some(32),
            ..Params::default()
        }
    }

    fn picture(path: &Path) -> Image<Srgb<u8>> {
        let mut report = Report::new("test", &());
        let picture = files::read(path, &mut report, &Context::default());
        picture.unwrap().convert()
    }

    #[test]
    fn every_scene_comes_with_its_truth() {
        let folder = tempfile::tempdir().unwrap();
        let report = run(folder.path(), &small()).unwrap();
        assert_eq!(report.outputs.len(), 2 * SceneId::ALL.len());
        assert_eq!(report.seed, Some(1));
        for id in SceneId::ALL {
            let path = folder.path().join(id.name());
            let image = picture(&path.with_extension("png"));
            assert_eq!(image.size(), Size::new(48, 32).unwrap());
            let json = std::fs::read_to_string(path.with_extension("json")).unwrap();
            let truth: serde_json::Value = serde_json::from_str(&json).unwrap();
            assert_eq!(
                (&truth["scene"], &truth["width"]),
                (&id.name().into(), &48.into())
            );
            let truth: Truth = serde_json::from_value(truth["truth"].clone()).unwrap();
            assert_eq!(
                truth,
                render(id, image.size(), Seed(1)).truth,
                "{}",
                id.name()
            );
        }
    }

    #[test]
    fn a_clip_is_a_folder_of_frames_with_their_truth() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            scenes: vec![ClipId::Cars.into()],
            frames: Some(3),
            alpha: true,
            plate: true,
            noise_sigma: 4.0,
            ..small()
        };
        let report = run(folder.path(), &params).unwrap();
        assert_eq!(report.outputs.len(), 3 * 3 + 1);
        let mut clip = clip(ClipId::Cars, Size::new(48, 32).unwrap(), 3, Seed(1));
        clip.noise_sigma = 4.0;
        let place = folder.path().join("cars");
        for index in [0, 2] {
            let name = format!("frame_{index:05}.png");
            let frame = clip.frame(index);
            assert_eq!(picture(&place.join(&name)), frame.stored());
            assert_eq!(
                picture(&place.join("plate").join(&name)),
                frame.plate.convert::<Srgb<u8>>()
            );
            let alpha = picture(&place.join("alpha").join(&name));
            for (Srgb(stored), alpha) in alpha.pixels().iter().zip(frame.alpha.pixels()) {
                assert_eq!(*stored, [(alpha * 255.0).round() as u8; 3]);
            }
        }
        assert!(!place.join("frame_00003.png").exists());
        let json = std::fs::read_to_string(place.join("truth.json")).unwrap();
        let truth: ClipTruth = serde_json::from_str(&json).unwrap();
        assert_eq!(truth, clip.truth());
    }

    #[test]
    fn a_clip_writes_alpha_and_plate_only_if_asked() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            scenes: vec![ClipId::StillDisc.into(), SceneId::Disc.into()],
            frames: Some(2),
            jpeg: Some(90),
            ..small()
        };
        let report = run(folder.path(), &params).unwrap();
        assert_eq!(report.outputs.len(), 3 + 2);
        let place = folder.path().join("still-disc");
        assert!(place.join("frame_00001.jpg").exists() && !place.join("alpha").exists());
        assert!(folder.path().join("disc.jpg").exists());
    }

    #[test]
    fn noise_has_the_deviation_that_was_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let quiet = Params {
            scenes: vec![SceneId::EdgeGray.into()],
            ..Params::default()
        };
        let noisy = Params {
            noise_sigma: 5.0,
            ..quiet.clone()
        };
        let path = folder.path().join("edge-gray.png");
        let [quiet, noisy] = [quiet, noisy].map(|params| {
            run(folder.path(), &params).unwrap();
            picture(&path)
        });
        let squares = quiet
            .pixels()
            .iter()
            .zip(noisy.pixels())
            .flat_map(|(a, b)| [0, 1, 2].map(|c| (f64::from(a.0[c]) - f64::from(b.0[c])).powi(2)));
        let count = 3.0 * quiet.size().pixels() as f64;
        let sigma = (squares.sum::<f64>() / count).sqrt();
        // five standard errors of a deviation from this many samples; rounding adds 1/12 to the variance
        let expected = (25.0f64 + 1.0 / 12.0).sqrt();
        assert!(
            (sigma - expected).abs() < 5.0 * expected / (2.0 * count).sqrt(),
            "{sigma}"
        );
    }

    #[test]
    fn jpeg_files_are_jpeg_and_a_picture_with_alpha_says_what_it_lost() {
        let folder = tempfile::tempdir().unwrap();
        let damaged = Params {
            scenes: vec![SceneId::Disc.into(), SceneId::Sprite.into()],
            jpeg: Some(10),
            ..small()
        };
        let report = run(folder.path(), &damaged).unwrap();
        assert_eq!(report.outputs.len(), 4);
        assert_eq!(report.outputs[0].format, "JPEG");
        assert_eq!(report.warnings.len(), 1);
        assert!(
            report.warnings[0].contains("sprite.jpg"),
            "{}",
            report.warnings[0]
        );
    }

    #[test]
    fn parameters_out_of_range_are_refused_before_anything_is_made() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("never");
        for wrong in [
            Params {
                width: Some(15),
                ..small()
            },
            Params {
                height: Some(8193),
                ..small()
            },
            Params {
                noise_sigma: -1.0,
                ..small()
            },
            Params {
                noise_sigma: f64::NAN,
                ..small()
            },
            Params {
                jpeg: Some(0),
                ..small()
            },
            Params {
                jpeg: Some(101),
                ..small()
            },
            Params {
                frames: Some(0),
                ..small()
            },
            Params {
                frames: Some(100_001),
                ..small()
            },
        ] {
            let error = run(&out, &wrong).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Request, "{error}");
        }
        assert!(!out.exists());
    }

    #[test]
    fn a_cancelled_run_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let context = Context::default();
        context.progress.cancel();
        let out = folder.path().join("never");
        let operation = Scenes {
            out: out.clone(),
            params: small(),
        };
        assert!(matches!(operation.run(&context), Err(JobError::Cancelled)));
        assert!(!out.exists());
    }

    #[test]
    fn parameters_survive_json_and_what_is_left_out_is_default() {
        let text = serde_json::to_string(&small()).unwrap();
        assert_eq!(serde_json::from_str::<Params>(&text).unwrap(), small());
        let partial: Params =
            serde_json::from_str(r#"{"seed": 9, "scenes": ["line-art", "cuts"]}"#).unwrap();
        let expected = Params {
            seed: 9,
            scenes: vec![SceneId::LineArt.into(), ClipId::Cuts.into()],
            ..Params::default()
        };
        assert_eq!(partial, expected);
        let error = serde_json::from_str::<Params>(r#"{"scenes": ["cats"]}"#).unwrap_err();
        assert!(error.to_string().contains("cats"), "{error}");
        assert!(serde_json::from_str::<Params>(r#"{"sede": 9}"#).is_err());
    }
}
