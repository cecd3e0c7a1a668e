//! `mosaic`: a picture made of whole, unchanged photos.

mod by_hand;
mod desk;

pub use by_hand::{BannedPhoto, PinnedPhoto};
pub use desk::{MosaicDesk, Preview};
pub use ravec_catalogue::{MosaicWorker, TileCandidate};

use crate::catalogue::{check_side_outputs, journals};
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::report::{FileReport, Report};
use ravec::mosaic::{ChooseParams, Crop, Features, MAX_DEGREE, Rules, Weights};
use ravec::raster::Size;
use ravec_catalogue::{
    Catalogue, CatalogueError, MosaicParams, Outputs, leads_into, mosaic_in_memory,
    mosaic_in_pieces,
};
use ravec_media::{Format, Picture, WriteOptions};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// One number or two with an `x` between them, as in `80` or `80x60`; each 1 to 65535.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Sides {
    /// The first number.
    pub across: usize,
    /// The second number, if there is one.
    pub down: Option<usize>,
}

/// A text does not say sides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("one or two whole numbers from 1 to 65535 are needed, as in 80 or 80x60")]
pub struct SidesError;

impl Sides {
    /// One number for both sides.
    const fn square(across: usize) -> Self {
        Self { across, down: None }
    }
}

impl FromStr for Sides {
    type Err = SidesError;

    fn from_str(text: &str) -> Result<Self, SidesError> {
        let number = |text: &str| {
            let number = text.parse::<usize>().ok();
            number
                .filter(|number| (1..=65_535).contains(number))
                .ok_or(SidesError)
        };
        let (across, down) = match text.split_once('x') {
            Some((across, down)) => (across, Some(number(down)?)),
            None => (text, None),
        };
        Ok(Self {
            across: number(across)?,
            down,
        })
    }
}

impl TryFrom<String> for Sides {
    type Error = SidesError;

    fn try_from(text: String) -> Result<Self, SidesError> {
        text.parse()
    }
}

impl std::fmt::Display for Sides {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.down {
            Some(down) => write!(f, "{}x{down}", self.across),
            None => write!(f, "{}", self.across),
        }
    }
}

impl From<Sides> for String {
    fn from(sides: Sides) -> Self {
        sides.to_string()
    }
}

/// Compose a picture from whole, unchanged photos of a catalogue
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Mosaic {
    /// Input picture; `-` is standard input
    pub input: PathBuf,
    /// The catalogue of photos
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub catalogue: PathBuf,
    /// Output mosaic, .png, .jpg or .tif
    #[cfg_attr(
        feature = "cli",
        arg(
            short,
            long,
            value_name = "FILE",
            required_unless_present = "deep_zoom"
        )
    )]
    #[serde(default)]
    pub output: Option<PathBuf>,
    /// Output folder with a page that zooms from the mosaic into its photos
    #[cfg_attr(feature = "cli", arg(long, value_name = "DIR"))]
    #[serde(default)]
    pub deep_zoom: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec mosaic photo.jpg --catalogue photos.ravec -o mosaic.png --tiles 4x3 --crop center
  ravec mosaic photo.jpg --catalogue photos.ravec -o mosaic.jpg --tiles 3 --tile-size 32x24
  ravec mosaic photo.jpg --catalogue photos.ravec --deep-zoom zoom --tiles 4 --tile-size 256x192
  ravec mosaic photo.jpg --catalogue photos.ravec -o look.png --tiles 4x3 --crop center --preview
  ravec mosaic photo.jpg --catalogue photos.ravec -o f.png --tiles 4 --tile-size 36x27 --adaptive

Photos are scaled, and with --crop center cut to the proportions of a tile; they are never recolored or overlaid. Near-duplicates \
count as one photo. The mosaic is written row by row and may be much larger than the memory, up to --max-pixels; TIFF files beyond \
4 GiB become BigTIFF.

--deep-zoom makes a folder whose index.html shows the mosaic in a browser, without a network: wheel, drag and click, or the keys \
+ - arrows Enter Esc, lead into single photos, whose names are shown. mosaic.dzi there is for other viewers of Deep Zoom images. A \
larger --tile-size gives larger photos. The folder may be new, empty, or an older page, which is replaced; ravec-manifest.json there \
lists the files of a page, and a folder with anything else in it, or with a changed file, is refused.

--adaptive takes larger tiles where the picture is homogeneous and smaller ones where it has detail, off the grid, at most as many as \
there would be on it. --tile-size must be a multiple of 3. --feature-degree compares tiles through which an edge runs by their \
structure, and the others by --degree.

--pin 3,0:/photos/a.jpg gives the tile in column 3 and row 0, counted from 0, that photo, and --ban /photos/b.jpg uses that one and its \
near-duplicates nowhere, --ban 3,0:/photos/b.jpg not at that tile. Photos have the paths that ravec library list prints. Pinned \
photos count for the limits on repeats of all other tiles, and keep none among themselves.

--preview takes the small pictures in the catalogue in place of the photos, for trying out the other options.

Figures: columns, rows, tiles, features (tiles with an edge), photos (that fit the tiles), different (of these, to the eye), used, most_uses, nearest_repeat (in tiles; \
infinite, or null in JSON, if no photo is there twice), cost (weighted squared differences in Oklab), cost_bound (below which no \
choice can be), cost_gap_percent (infinite, or null in JSON, if the bound is 0 but for rounding), changes (of the improvement). In JSON, result has photos, the path of each tile's photo, \
and places, the left and upper border, width and height of each tile.";

/// Parameters of [`Mosaic`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Columns and rows of tiles, as in 80x60; with one number, the rows follow from the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "COLSxROWS", default_value_t = Self::default().tiles))]
    pub tiles: Sides,
    /// Size of a tile in pixels, as in 90x60; one number is a square [default: 64, with --adaptive 66]
    ///
    /// With --adaptive both must be multiples of 3.
    #[cfg_attr(feature = "cli", arg(long, value_name = "WIDTHxHEIGHT"))]
    pub tile_size: Option<Sides>,
    /// Use of photos whose aspect ratio is not that of a tile
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub crop: Crop,
    /// Maximum uses of a photo [default: no limit]
    #[cfg_attr(feature = "cli", arg(long, value_name = "COUNT"))]
    pub max_uses: Option<u32>,
    /// Minimum distance between two tiles with the same photo, in tiles, 0 to 1000
    #[cfg_attr(feature = "cli", arg(long, value_name = "TILES", default_value_t = Self::default().min_repeat_distance))]
    pub min_repeat_distance: f64,
    /// Use every photo at least once
    #[cfg_attr(feature = "cli", arg(long))]
    pub use_all: bool,
    /// Degree of the polynomials that describe a tile, 0 (mean colors) to 5
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREE", default_value_t = Self::default().degree))]
    pub degree: usize,
    /// Weight of structure against color, 0 to 1; low for posters seen from a distance
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().detail))]
    pub detail: f64,
    /// Compare tiles through which an edge runs up to this degree, 0 to 5 [default: like all others]
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREE"))]
    pub feature_degree: Option<usize>,
    /// Weight of tiles with an edge under --feature-degree, 0.1 to 10
    #[cfg_attr(feature = "cli", arg(long, value_name = "FACTOR", default_value_t = Self::default().feature_weight))]
    pub feature_weight: f64,
    /// Larger tiles where the picture is homogeneous and smaller ones where it is not, off the grid; at most as many
    #[cfg_attr(feature = "cli", arg(long))]
    pub adaptive: bool,
    /// Seed of the tiles that are off the grid
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Self::default().seed))]
    pub seed: u64,
    /// A tile and the photo that it has, as in 3,0:/photos/a.jpg; not with --adaptive. May be repeated
    #[cfg_attr(feature = "cli", arg(long = "pin", value_name = "COL,ROW:PHOTO"))]
    pub pins: Vec<PinnedPhoto>,
    /// A photo that is not used, as in /photos/b.jpg, or not at a tile, as in 3,0:/photos/b.jpg. May be repeated
    #[cfg_attr(feature = "cli", arg(long = "ban", value_name = "[COL,ROW:]PHOTO"))]
    pub bans: Vec<BannedPhoto>,
    /// Weight with which neighbors compensate one another's errors, 0 to 1; 0 treats each tile alone
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().blend))]
    pub blend: f64,
    /// Rounds in which photos change and tiles swap, 0 to 100
    #[cfg_attr(feature = "cli", arg(long, value_name = "COUNT", default_value_t = Self::default().rounds))]
    pub rounds: usize,
    /// Rounds in which tiles off the grid give way to others, 0 to 100 [default: 20, for a preview 1]
    #[cfg_attr(feature = "cli", arg(long, value_name = "COUNT"))]
    pub tiling_rounds: Option<usize>,
    /// A quick look: at most 1600 pixels a side, made of the small pictures in the catalogue
    #[cfg_attr(feature = "cli", arg(long))]
    pub preview: bool,
    /// Quality of a JPEG output and of a page that zooms, 1 to 100
    #[cfg_attr(feature = "cli", arg(long, value_name = "PERCENT", default_value_t = Self::default().quality))]
    pub quality: u8,
}

impl Default for Params {
    fn default() -> Self {
        let choose = ChooseParams::default();
        Self {
            tiles: Sides::square(60),
            tile_size: None,
            crop: Crop::Never,
            max_uses: None,
            min_repeat_distance: Rules::default().min_repeat_distance,
            use_all: false,
            degree: choose.weights.degree,
            detail: choose.weights.detail,
            feature_degree: None,
            feature_weight: 1.0,
            adaptive: false,
            seed: 0,
            pins: Vec::new(),
            bans: Vec::new(),
            blend: choose.blend,
            rounds: choose.rounds,
            tiling_rounds: None,
            preview: false,
            quality: 92,
        }
    }
}

/// The default side of a tile, in pixels: enough to recognize a photo on a screen.
const TILE_PX: usize = 64;

/// The multiple of three next to it, for tiles that are cut into thirds.
const ADAPTIVE_TILE_PX: usize = 66;

/// Scaled photos that are kept for later rows, in bytes.
const KEPT_BYTES: usize = 128 << 20;

/// Rounds of tiles in a preview: the first takes the tiles off what they began as, and shows where they are large.
const PREVIEW_TILING_ROUNDS: usize = 1;

/// The longer side of a preview: what a screen shows at once.
const PREVIEW_PX: usize = 1600;

impl Operation for Mosaic {
    const NAME: &'static str = "mosaic";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input, &self.catalogue]
    }

    fn outputs(&self) -> Vec<&Path> {
        self.output.as_deref().into_iter().collect()
    }

    fn folders(&self) -> Vec<&Path> {
        self.deep_zoom.as_deref().into_iter().collect()
    }

    fn side_files(&self) -> Vec<PathBuf> {
        journals(&self.catalogue)
    }

    /// Composes the picture from the photos of the catalogue, each scaled and, on request, cropped, and nothing else.
    ///
    /// No output may be the catalogue or a photo that it knows. The picture may stay in memory.
    ///
    /// Figures: `columns`, `rows`, `tiles`, `features` (tiles with an edge, if compared in their own way), `photos` (that fit the tiles), `different` (of these, to the eye), `used`, `most_uses`,
    /// `nearest_repeat` (in tiles; infinite if no photo is there twice), `cost` (the sum over tiles of the mean squared
    /// difference in Oklab, weighted), `cost_bound` (below which no choice can be), `cost_gap_percent`, `changes` (of the
    /// improvement). The report's `result` has `photos`, the path of each tile's photo, and `places`, the left and upper border,
    /// width and height of each tile in pixels. Photos that are gone are warnings.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Missing`], [`JobError::Read`], [`JobError::Catalogue`], [`JobError::Write`],
    /// [`JobError::NotInMemory`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            catalogue,
            params,
            ..
        } = self;
        let progress = &context.progress;
        let output = self.output.as_deref();
        let in_memory = output.filter(|path| context.is_intermediate(path));
        let outputs = &Outputs {
            picture: output.filter(|_| in_memory.is_none()),
            deep_zoom: self.deep_zoom.as_deref(),
        };
        let settings = checked(params)?;
        if output.is_none() && outputs.deep_zoom.is_none() {
            return Err(JobError::Missing {
                fields: &["output", "deep_zoom"],
                expected: "give a file or a folder to write",
            });
        }
        for path in self.folders().into_iter().chain([&**catalogue]) {
            context.check_is_file(path)?;
        }
        let format = outputs.picture.and_then(Format::from_extension);
        if let Some(output) = outputs.picture {
            if !matches!(format, Some(Format::Png | Format::Jpeg | Format::Tiff)) {
                return Err(JobError::Parameter {
                    field: "output",
                    value: output.display().to_string(),
                    range: "a file with the extension .png, .jpg, .jpeg, .tif or .tiff",
                });
            }
            context.check_files(&self.inputs(), &[output])?;
        }
        if let Some(folder) = outputs.deep_zoom {
            files::check_folder(folder)?;
        }
        let catalogue =
            Catalogue::open_to_read(catalogue, progress).map_err(JobError::from_catalogue)?;
        check_outputs(&catalogue, outputs, context).map_err(JobError::from_catalogue)?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let (limits, image) = (&context.limits, &picture.image);
        let mosaic = report.time("mosaic", || {
            if in_memory.is_some() {
                let page = outputs.deep_zoom;
                let made = mosaic_in_memory(&catalogue, image, page, &settings, limits, progress)?;
                Ok((made.0, Some(made.1)))
            } else {
                let made = match context.cluster.as_deref() {
                    Some(cluster) => mosaic_in_pieces(
                        &catalogue, image, outputs, &settings, limits, cluster, progress,
                    ),
                    None => ravec_catalogue::mosaic(
                        &catalogue, image, outputs, &settings, limits, progress,
                    ),
                };
                Ok((made?, None))
            }
        });
        let (mosaic, pixels) = mosaic.map_err(JobError::from_catalogue)?;
        for warning in &mosaic.warnings {
            report.warn(warning.clone());
        }
        if let (Some(output), Some(pixels)) = (in_memory, pixels) {
            let picture = Picture::from_image(pixels);
            let options = WriteOptions::default();
            files::write(output, &picture, &options, &mut report, context)?;
        }
        let written = [
            (outputs.picture, format.map_or("", Format::name)),
            (outputs.deep_zoom, "Deep Zoom"),
        ];
        for (path, format) in written {
            report.outputs.extend(path.map(|path| FileReport {
                path: path.display().to_string(),
                format: format.to_owned(),
                width: Some(mosaic.size.width()),
                height: Some(mosaic.size.height()),
                pixels: Some("8 bit"),
                ..FileReport::default()
            }));
        }
        record(&mosaic, &mut report);
        Ok(report)
    }
}

/// Squared difference in Oklab of a tile that is the rounding of its computation.
const ROUNDING: f64 = 1e-8;

/// Distance of a cost from its lower bound, in percent of the bound; infinite where the bound is nothing beside the cost.
fn gap_percent(cost: f64, bound: f64, tiles: usize) -> f64 {
    let gap = (cost - bound).max(0.0);
    let rounding = ROUNDING * tiles as f64;
    if gap <= rounding {
        0.0
    } else if bound <= rounding {
        f64::INFINITY
    } else {
        100.0 * gap / bound
    }
}

/// Enters the figures and the places of the tiles into the report.
fn record(mosaic: &ravec_catalogue::Mosaic, report: &mut Report) {
    let (cost, bound) = (mosaic.choice.cost, mosaic.choice.bound);
    let gap = gap_percent(cost, bound, mosaic.photos.len());
    for (name, figure) in [
        ("columns", mosaic.tiles.0 as f64),
        ("rows", mosaic.tiles.1 as f64),
        ("tiles", mosaic.photos.len() as f64),
        ("features", mosaic.features as f64),
        ("photos", mosaic.fitting as f64),
        ("different", mosaic.different as f64),
        ("used", mosaic.used as f64),
        ("most_uses", mosaic.max_uses as f64),
        (
            "nearest_repeat",
            mosaic.nearest_repeat.unwrap_or(f64::INFINITY),
        ),
        ("cost", cost),
        ("cost_bound", bound),
        ("cost_gap_percent", gap),
        ("changes", mosaic.choice.changes as f64),
    ] {
        report.figures.insert(name, figure);
    }
    let photos: Vec<_> = mosaic
        .photos
        .iter()
        .map(|path| path.to_string_lossy())
        .collect();
    let places: Vec<_> = mosaic
        .places
        .iter()
        .map(|place| [place.col, place.row, place.width, place.height])
        .collect();
    report.result = Some(json!({ "photos": photos, "places": places }));
}

/// Refuses outputs in the way of the catalogue, of photos that it knows or of one another, before the picture is read.
fn check_outputs(
    catalogue: &Catalogue,
    outputs: &Outputs<'_>,
    context: &Context,
) -> Result<(), CatalogueError> {
    check_side_outputs(catalogue, context)?;
    if let Some(picture) = outputs.picture {
        catalogue.check_output(picture)?;
    }
    let Some(folder) = outputs.deep_zoom else {
        return Ok(());
    };
    catalogue.check_output_folder(folder)?;
    let side_outputs = context.side_outputs.iter().map(PathBuf::as_path);
    let inside = side_outputs
        .chain(outputs.picture)
        .find(|path| !files::is_stream(path) && leads_into(path, folder));
    inside.map_or(Ok(()), |path| {
        Err(CatalogueError::Protected {
            path: path.into(),
            reason: "it would lie in the folder of the page",
        })
    })
}

fn checked(params: &Params) -> Result<MosaicParams, JobError> {
    let wrong = |field: &'static str, value: String, range: &'static str| {
        Err(JobError::Parameter {
            field,
            value,
            range,
        })
    };
    if !(0.0..=1000.0).contains(&params.min_repeat_distance) {
        let value = params.min_repeat_distance.to_string();
        return wrong("min_repeat_distance", value, "0 to 1000");
    }
    if params.max_uses == Some(0) {
        return wrong("max_uses", "0".into(), "1 or more");
    }
    if params.degree > MAX_DEGREE {
        return wrong("degree", params.degree.to_string(), "0 to 5");
    }
    if let Some(degree) = params.feature_degree.filter(|&degree| degree > MAX_DEGREE) {
        return wrong("feature_degree", degree.to_string(), "0 to 5");
    }
    if !(0.1..=10.0).contains(&params.feature_weight) {
        let value = params.feature_weight.to_string();
        return wrong("feature_weight", value, "0.1 to 10");
    }
    for (name, value) in [("detail", params.detail), ("blend", params.blend)] {
        if !(0.0..=1.0).contains(&value) {
            return wrong(name, value.to_string(), "0 to 1");
        }
    }
    for (name, rounds) in [
        ("rounds", Some(params.rounds)),
        ("tiling_rounds", params.tiling_rounds),
    ] {
        if let Some(rounds) = rounds.filter(|&rounds| rounds > 100) {
            return wrong(name, rounds.to_string(), "0 to 100");
        }
    }
    if !(1..=100).contains(&params.quality) {
        return wrong("quality", params.quality.to_string(), "1 to 100");
    }
    let side = params
        .tile_size
        .unwrap_or(Sides::square(if params.adaptive {
            ADAPTIVE_TILE_PX
        } else {
            TILE_PX
        }));
    let tile = Size::new(side.across, side.down.unwrap_or(side.across));
    let tile = tile.map_err(|_| JobError::Parameter {
        field: "tile_size",
        value: side.to_string(),
        range: "1 to 65535 pixels each way",
    })?;
    let choose = ChooseParams::default();
    Ok(MosaicParams {
        columns: params.tiles.across,
        rows: params.tiles.down,
        tile,
        crop: params.crop,
        rules: Rules {
            max_uses: params.max_uses,
            min_repeat_distance: params.min_repeat_distance,
            use_all: params.use_all,
        },
        choose: ChooseParams {
            weights: Weights {
                degree: params.degree,
                detail: params.detail,
            },
            features: params.feature_degree.map(|degree| Features {
                degree,
                weight: params.feature_weight,
            }),
            blend: params.blend,
            rounds: params.rounds,
            tiling_rounds: params.tiling_rounds.unwrap_or(if params.preview {
                PREVIEW_TILING_ROUNDS
            } else {
                choose.tiling_rounds
            }),
            candidates: choose.candidates,
        },
        adaptive: params.adaptive.then_some(params.seed),
        quality: params.quality,
        pins: params.pins.iter().map(Into::into).collect(),
        bans: params.bans.iter().map(Into::into).collect(),
        kept_bytes: KEPT_BYTES,
        preview_px: params.preview.then_some(PREVIEW_PX),
    })
}

impl JobError {
    /// Converts an error of a catalogue or of a mosaic.
    pub(crate) fn from_catalogue(cause: CatalogueError) -> Self {
        match cause {
            CatalogueError::Cancelled(_) => Self::Cancelled,
            CatalogueError::Write(error) => error.into(),
            cause => Self::Catalogue(cause),
        }
    }
}

#[cfg(test)]
mod tests;
