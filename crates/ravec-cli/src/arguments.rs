//! The command line: one definition for the parser, the help, the completions and the manual.

mod library;
mod mesh;

use crate::help;
use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::{ArgGroup, Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use ravec::memory::MemoryBudget;
use ravec_jobs::mesh::{NamedFile, boolean, offset};
use ravec_jobs::plane::{planes, rectify, snap};
use ravec_jobs::{
    Limits, brush, compare, complete, match_photos, mosaic, retarget, scenes, twocolor,
};
use std::path::{Path, PathBuf};

pub use library::LibraryCommand;
pub use mesh::{MeshCommand, MeshLimitFlags};

/// Raster and vector views of images that work together.
#[derive(Debug, Parser)]
#[command(
    name = "ravec",
    version,
    after_help = help::PROGRAM,
    arg_required_else_help = true,
    propagate_version = true
)]
pub struct Arguments {
    /// The operation.
    #[command(subcommand)]
    pub command: Command,
    /// Options common to all operations.
    #[command(flatten)]
    pub global: Global,
}

/// The operations.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Compare two pictures of the same size: PSNR, SSIM, color difference
    #[command(after_help = help::COMPARE)]
    Compare {
        /// Reference; `-` is standard input
        a: PathBuf,
        /// Picture to compare with it; `-` is standard input
        b: PathBuf,
        #[command(flatten)]
        params: compare::Params,
    },
    /// Match two photos of a plane: find the homography from one to the other
    #[command(after_help = help::MATCH)]
    Match {
        /// Source photo; `-` is standard input
        first: PathBuf,
        /// Target photo; `-` is standard input
        second: PathBuf,
        /// Output text file: the nine entries of the matrix, row by row; `-` is standard output
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        params: match_photos::Params,
    },
    /// Rectify a plane of a picture: show it from the front, with its true proportions
    #[command(after_help = help::planes::RECTIFY)]
    Rectify {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Output picture; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        params: rectify::Params,
    },
    /// Snap a rough grid to the edges below it, and print its corners as JSON
    #[command(after_help = help::planes::SNAP)]
    Snap {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Output picture of the grid before (orange) and after (green), or the result if the name ends in .json
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
        #[command(flatten)]
        params: snap::Params,
    },
    /// Propose planes from the edges of a picture, and print them as JSON
    #[command(after_help = help::planes::PLANES)]
    Planes {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Output picture of the planes and the edges that support them, or the planes if the name ends in .json
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
        #[command(flatten)]
        params: planes::Params,
    },
    /// Fill holes in a picture from the rest of it, in perspective where planes are given
    #[command(
        after_help = help::COMPLETE,
        group = ArgGroup::new("hole").args(["mask", "polygons"]).required(true).multiple(true)
    )]
    Complete {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Mask of the pixels to replace, of the same size: white replaces, black keeps, gray mixes; `-` is standard input
        #[arg(short, long, value_name = "FILE")]
        mask: Option<PathBuf>,
        /// Mask of the structure to continue, of the same size: white on it, inside and outside the hole
        #[arg(long, value_name = "FILE")]
        features: Option<PathBuf>,
        /// Another photo that fragments may come from. May be repeated
        #[arg(long = "source", value_name = "FILE")]
        sources: Vec<PathBuf>,
        /// Replay the steps of this file, which `--steps` wrote, instead of searching
        #[arg(long, value_name = "FILE")]
        replay: Option<PathBuf>,
        /// Write the steps as JSON; `-` is standard output
        #[arg(long, value_name = "FILE")]
        steps: Option<PathBuf>,
        /// Output picture; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        params: complete::Params,
    },
    /// Change the aspect ratio of a picture: objects keep their shape, straight lines stay straight
    #[command(after_help = help::RETARGET)]
    Retarget {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Output picture; its extension selects the format, `-` is standard output in the input's format. With several
        /// sizes `{size}` in the name stands for each
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// Mask of the objects that keep their shape, of the same size, white on black; `-` is standard input
        #[arg(long, value_name = "MASK")]
        protect: Option<PathBuf>,
        /// Mask of the areas that may be squeezed or stretched first, likewise
        #[arg(long, value_name = "MASK")]
        give_way: Option<PathBuf>,
        /// Write the deformed grid and the straight lines as well, over the result or, if the name ends in .svg, as a drawing
        #[arg(long, value_name = "FILE")]
        show_grid: Option<PathBuf>,
        #[command(flatten)]
        params: retarget::Params,
    },
    /// Convert a picture to two-color pixels: blocks of one line and two colors, sharp at any scale
    #[command(
        after_help = help::TWOCOLOR,
        group = ArgGroup::new("result").args(["output", "svg"]).required(true).multiple(true)
    )]
    Twocolor {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Output picture; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
        /// Output drawing as SVG, with neighbors of equal color merged; `-` is standard output
        #[arg(long, value_name = "FILE")]
        svg: Option<PathBuf>,
        #[command(flatten)]
        params: twocolor::Params,
    },
    /// Filter or paint a picture, as a whole or with a brush that stops at edges
    #[command(after_help = help::BRUSH)]
    Brush {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// Output picture; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// Apply the mode to the whole picture
        #[arg(long, required_unless_present = "stroke", conflicts_with = "stroke")]
        everywhere: bool,
        /// Strokes as JSON, or the points [[x, y], ...] of one stroke with the settings of the flags: see below; `-` is
        /// standard input
        #[arg(long, value_name = "FILE")]
        stroke: Option<PathBuf>,
        /// Write the selection that mask strokes painted as a gray picture
        #[arg(
            long,
            value_name = "FILE",
            requires = "stroke",
            conflicts_with = "everywhere"
        )]
        mask: Option<PathBuf>,
        #[command(flatten)]
        params: brush::Params,
    },
    /// Describe, check, convert, compare, render and simplify triangle meshes
    #[command(
        after_help = help::mesh::MESH,
        arg_required_else_help = true,
        subcommand_required = true
    )]
    Mesh {
        /// The operation.
        #[command(subcommand)]
        command: MeshCommand,
        /// Limits for reading.
        #[command(flatten)]
        limits: MeshLimitFlags,
    },
    /// Compute the surface at a distance from any triangles, closed and proved to lie within a tolerance
    ///
    /// The exit code is 5 if the result was written but the proof failed.
    #[command(after_help = help::OFFSET)]
    Offset {
        /// Input mesh; `-` is standard input
        input: PathBuf,
        /// Output mesh; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        params: offset::Params,
        /// Limits for reading.
        #[command(flatten)]
        limits: MeshLimitFlags,
    },
    /// Combine meshes by a Boolean expression, exactly; triangles away from the cuts stay unchanged
    ///
    /// The exit code is 5 if the result was written but is not solid.
    #[command(after_help = help::BOOLEAN)]
    Boolean {
        /// Boolean expression, as in '(a | b) - c & d': | is union, & intersection, - difference, ^ symmetric difference; & comes
        /// before the others, which go from left to right. Or union, intersection, difference or symmetric-difference of
        /// all files
        #[arg(value_name = "EXPRESSION")]
        expression: String,
        /// Input meshes, each with its name in the expression; without names they are a, b, c and so on. `-` is standard input
        #[arg(required = true, value_name = "[NAME=]FILE", value_parser = OsStringValueParser::new().map(NamedFile::from))]
        files: Vec<NamedFile>,
        /// Output mesh; its extension selects the format, `-` is standard output in the first input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// Write the origin of each triangle, as .csv or .json: its mesh, its index there, whether it was flipped, and whether
        /// it is whole
        #[arg(long, value_name = "FILE")]
        origins: Option<PathBuf>,
        /// Render the result: whole triangles blue, pieces orange, closed holes green, seams red
        #[arg(long, value_name = "FILE")]
        picture: Option<PathBuf>,
        /// Print a report instead of the summary, as `--json -` does
        #[arg(long, value_enum, value_name = "FORMAT", conflicts_with = "json")]
        report: Option<ReportFormat>,
        #[command(flatten)]
        params: boolean::Params,
        /// Limits for reading.
        #[command(flatten)]
        limits: MeshLimitFlags,
    },
    /// Manage a catalogue of photos for mosaics
    #[command(
        after_help = help::library::LIBRARY,
        arg_required_else_help = true,
        subcommand_required = true
    )]
    Library {
        /// The operation.
        #[command(subcommand)]
        command: LibraryCommand,
    },
    /// Compose a picture from whole, unchanged photos of a catalogue
    #[command(after_help = help::library::MOSAIC)]
    Mosaic {
        /// Input picture; `-` is standard input
        input: PathBuf,
        /// The catalogue of photos
        #[arg(long, value_name = "FILE")]
        catalogue: PathBuf,
        /// Output mosaic, .png, .jpg or .tif
        #[arg(
            short,
            long,
            value_name = "FILE",
            required_unless_present = "deep_zoom"
        )]
        output: Option<PathBuf>,
        /// Output folder with a page that zooms from the mosaic into its photos
        #[arg(long, value_name = "DIR")]
        deep_zoom: Option<PathBuf>,
        #[command(flatten)]
        params: mosaic::Params,
    },
    /// Run every system on built-in scenes or a photo, and write a page with the results
    #[command(after_help = help::DEMO)]
    Demo {
        /// A photo to use instead of the built-in street; `-` is standard input
        #[arg(long, value_name = "PHOTO")]
        image: Option<PathBuf>,
        /// Output folder; created if it is missing
        #[arg(short, long, value_name = "DIR", default_value = "ravec-demo")]
        out: PathBuf,
        #[command(flatten)]
        params: ravec_demo::Params,
    },
    /// Write procedural pictures with their ground truth
    #[command(after_help = help::SCENES)]
    Scenes {
        /// Output folder; created if it is missing
        #[arg(short, long, value_name = "DIR")]
        out: PathBuf,
        #[command(flatten)]
        params: scenes::Params,
    },
    /// Print a completion script for a shell
    #[command(after_help = help::COMPLETIONS)]
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Print the manual page, or write the pages of all commands into a folder
    #[command(after_help = help::MAN)]
    Man {
        /// Output folder; created if it is missing
        #[arg(short, long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// A form of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ReportFormat {
    /// As JSON
    Json,
}

impl Command {
    /// The files that the operation reads.
    pub fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Compare { a, b, .. } => vec![a, b],
            Self::Match { first, second, .. } => vec![first, second],
            Self::Complete {
                input,
                mask,
                features,
                sources,
                replay,
                ..
            } => {
                let first = std::iter::once(input.as_path());
                let masks = mask.as_deref().into_iter().chain(features.as_deref());
                let sources = sources.iter().map(PathBuf::as_path);
                first
                    .chain(masks)
                    .chain(sources)
                    .chain(replay.as_deref())
                    .collect()
            }
            Self::Retarget {
                input,
                protect,
                give_way,
                ..
            } => std::iter::once(input.as_path())
                .chain(protect.as_deref())
                .chain(give_way.as_deref())
                .collect(),
            Self::Twocolor { input, .. }
            | Self::Rectify { input, .. }
            | Self::Snap { input, .. }
            | Self::Planes { input, .. }
            | Self::Offset { input, .. } => vec![input],
            Self::Boolean { files, .. } => files.iter().map(|file| file.path.as_path()).collect(),
            Self::Brush { input, stroke, .. } => {
                let stroke = stroke.as_deref();
                std::iter::once(input.as_path()).chain(stroke).collect()
            }
            Self::Mosaic {
                input, catalogue, ..
            } => vec![input, catalogue],
            Self::Mesh { command, .. } => command.inputs(),
            Self::Demo { image, .. } => image.as_deref().into_iter().collect(),
            Self::Library { command } => command.inputs(),
            Self::Scenes { .. } | Self::Completions { .. } | Self::Man { .. } => Vec::new(),
        }
    }

    /// The catalogue of photos that the operation uses.
    pub fn catalogue(&self) -> Option<&Path> {
        match self {
            Self::Mosaic { catalogue, .. } => Some(catalogue),
            Self::Library { command } => Some(command.catalogue()),
            _ => None,
        }
    }

    /// The files that the operation writes, apart from those in a folder that it fills.
    pub fn outputs(&self) -> Vec<&Path> {
        match self {
            Self::Twocolor { output, svg, .. } => output
                .as_deref()
                .into_iter()
                .chain(svg.as_deref())
                .collect(),
            Self::Brush { output, mask, .. } => std::iter::once(output.as_path())
                .chain(mask.as_deref())
                .collect(),
            Self::Retarget {
                output, show_grid, ..
            } => std::iter::once(output.as_path())
                .chain(show_grid.as_deref())
                .collect(),
            Self::Mesh { command, .. } => command.outputs(),
            Self::Boolean {
                output,
                origins,
                picture,
                ..
            } => std::iter::once(output.as_path())
                .chain(origins.as_deref())
                .chain(picture.as_deref())
                .collect(),
            Self::Snap { output, .. }
            | Self::Planes { output, .. }
            | Self::Mosaic { output, .. } => output.as_deref().into_iter().collect(),
            Self::Complete { output, steps, .. } => std::iter::once(output.as_path())
                .chain(steps.as_deref())
                .collect(),
            Self::Offset { output, .. }
            | Self::Match { output, .. }
            | Self::Rectify { output, .. } => vec![output],
            _ => Vec::new(),
        }
    }
}

/// Flags that every operation takes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Global options")]
pub struct Global {
    /// Log to standard error; twice: in detail
    #[arg(short, long, global = true, action = clap::ArgAction::Count, conflicts_with = "quiet")]
    pub verbose: u8,
    /// Print errors only
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Write a report of the run as JSON; `-` writes it to standard output
    #[arg(long, global = true, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Number of threads, 1 to 1024 [default: all cores]. The result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Maximum number of pixels of a picture, read or written; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = Limits::default().max_pixels)]
    pub max_pixels: u64,
    /// Memory budget in bytes for all inputs together, while they are read and as long as they are needed; `k`, `M` and
    /// `G` multiply by powers of 1000 [default: half of the memory of the machine]
    #[arg(long, global = true, value_name = "COUNT", value_parser = count)]
    pub max_bytes: Option<u64>,
}

impl Global {
    /// The limits for reading pictures, with a new memory budget. All inputs of a run share the budget of one call.
    pub fn limits(&self) -> Limits {
        let memory = self
            .max_bytes
            .map_or_else(MemoryBudget::default, MemoryBudget::new);
        Limits {
            max_pixels: self.max_pixels,
            memory,
        }
    }
}

/// A positive whole number with an optional `k`, `M` or `G`.
fn count(text: &str) -> Result<u64, String> {
    let (digits, factor) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (&text[..at], 1_000),
        Some((at, 'm' | 'M')) => (&text[..at], 1_000_000),
        Some((at, 'g' | 'G')) => (&text[..at], 1_000_000_000),
        _ => (text, 1),
    };
    digits
        .parse::<u64>()
        .ok()
        .and_then(|number| number.checked_mul(factor))
        .filter(|&number| number > 0)
        .ok_or_else(|| "a positive whole number is needed, as in 500000000 or 500M".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;
    use ravec_jobs::mesh::compare as mesh_compare;
    use ravec_jobs::mesh::{MeshLimits, check, convert, info, render, simplify};

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn the_files_of_an_operation_are_known_before_it_runs() {
        let files = |line: &str| {
            let command = Arguments::parse_from(line.split(' ')).command;
            let text = |paths: Vec<&Path>| {
                let names: Vec<_> = paths.iter().map(|path| path.to_str().unwrap()).collect();
                names.join(" ")
            };
            (text(command.inputs()), text(command.outputs()))
        };
        for (line, inputs, outputs) in [
            ("ravec compare a b", "a b", ""),
            ("ravec match a b -o c", "a b", "c"),
            ("ravec rectify a -o b --quad 0,0,9,0,9,9,0,9", "a", "b"),
            ("ravec snap a -o b --quad 0,0,9,0,9,9,0,9", "a", "b"),
            ("ravec planes a -o b", "a", "b"),
            ("ravec complete a --mask b -o c", "a b", "c"),
            (
                "ravec retarget a -o b -s 50% --protect c --give-way d --show-grid e",
                "a c d",
                "b e",
            ),
            (
                "ravec complete a --mask b -o c --source d --source e --features f --replay g --steps h",
                "a b f d e g",
                "c h",
            ),
            ("ravec twocolor a -o b --svg c", "a", "b c"),
            ("ravec brush a -o b --stroke c --mask d", "a c", "b d"),
            ("ravec brush a -o b --everywhere", "a", "b"),
            ("ravec mesh info a", "a", ""),
            ("ravec mesh check a", "a", ""),
            ("ravec mesh convert a -o b", "a", "b"),
            ("ravec mesh compare a b", "a b", ""),
            ("ravec mesh render a -o b --compare c", "a c", "b"),
            ("ravec mesh simplify a -o b --error 1", "a", "b"),
            ("ravec offset a -o b --distance 1", "a", "b"),
            (
                "ravec boolean x|b x=a b -o c --origins d --picture e",
                "a b",
                "c d e",
            ),
            ("ravec mosaic a --catalogue b -o c", "a b", "c"),
            ("ravec library stats --catalogue a", "a", ""),
            ("ravec library add a b --catalogue c", "c a b", ""),
            ("ravec library remove a --catalogue b", "b", ""),
            ("ravec demo --image a", "a", ""),
            ("ravec scenes -o a", "", ""),
        ] {
            assert_eq!(
                files(line),
                (inputs.to_owned(), outputs.to_owned()),
                "{line}"
            );
        }
    }

    #[test]
    fn counts_take_a_power_of_a_thousand() {
        assert_eq!(count("12"), Ok(12));
        assert_eq!(count("5k"), Ok(5_000));
        assert_eq!(count("2M"), Ok(2_000_000));
        assert_eq!(count("3G"), Ok(3_000_000_000));
        for wrong in ["", "0", "k", "-1", "1.5M", "99999999999999999G", "1é"] {
            assert!(count(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn flags_left_out_give_the_default_parameters() {
        let parsed = Arguments::parse_from(["ravec", "compare", "a", "b"]);
        let Command::Compare { params, .. } = parsed.command else {
            panic!("not compare");
        };
        assert_eq!(params, compare::Params::default());
        let parsed = Arguments::parse_from(["ravec", "match", "a", "b", "-o", "c"]);
        let Command::Match { params, .. } = parsed.command else {
            panic!("not match");
        };
        assert_eq!(params, match_photos::Params::default());
        let quad = "0,0,9,0,9,9,0,9";
        let parsed = Arguments::parse_from(["ravec", "rectify", "a", "-o", "b", "--quad", quad]);
        let Command::Rectify { params, .. } = parsed.command else {
            panic!("not rectify");
        };
        assert_eq!(params, rectify::Params::new(quad.parse().unwrap()));
        let parsed = Arguments::parse_from(["ravec", "snap", "a", "--quad", quad]);
        let Command::Snap { params, .. } = parsed.command else {
            panic!("not snap");
        };
        assert_eq!(params, snap::Params::new(quad.parse().unwrap()));
        let parsed = Arguments::parse_from(["ravec", "planes", "a"]);
        let Command::Planes { params, .. } = parsed.command else {
            panic!("not planes");
        };
        assert_eq!(params, planes::Params::default());
        let parsed = Arguments::parse_from(["ravec", "complete", "a", "-m", "b", "-o", "c"]);
        let Command::Complete { params, .. } = parsed.command else {
            panic!("not complete");
        };
        assert_eq!(params, complete::Params::default());
        let parsed = Arguments::parse_from(["ravec", "retarget", "a", "-o", "b", "-s", "50%"]);
        let Command::Retarget { params, .. } = parsed.command else {
            panic!("not retarget");
        };
        let half = retarget::Params {
            sizes: vec!["50%".parse().unwrap()],
            ..retarget::Params::default()
        };
        assert_eq!(params, half);
        let parsed = Arguments::parse_from(["ravec", "scenes", "--out", "d"]);
        let Command::Scenes { params, .. } = parsed.command else {
            panic!("not scenes");
        };
        assert_eq!(params, scenes::Params::default());
        let parsed = Arguments::parse_from(["ravec", "twocolor", "a", "-o", "b"]);
        let Command::Twocolor { params, .. } = parsed.command else {
            panic!("not twocolor");
        };
        assert_eq!(params, twocolor::Params::default());
        let parsed = Arguments::parse_from(["ravec", "brush", "a", "-o", "b", "--everywhere"]);
        let Command::Brush { params, .. } = parsed.command else {
            panic!("not brush");
        };
        assert_eq!(params, brush::Params::default());
        let parsed = Arguments::parse_from(["ravec", "offset", "a", "-o", "b", "-d", "2%"]);
        let Command::Offset { params, .. } = parsed.command else {
            panic!("not offset");
        };
        assert_eq!(params, offset::Params::default());
        let parsed = Arguments::parse_from(["ravec", "boolean", "union", "a", "-o", "b"]);
        let Command::Boolean { params, .. } = parsed.command else {
            panic!("not boolean");
        };
        assert_eq!(params, boolean::Params::default());
        let parsed = Arguments::parse_from(["ravec", "demo"]);
        let Command::Demo { params, .. } = parsed.command else {
            panic!("not demo");
        };
        assert_eq!(params, ravec_demo::Params::default());
        assert_eq!(parsed.global.limits(), Limits::default());
    }

    #[test]
    fn flags_left_out_give_the_default_parameters_of_operations_on_meshes() {
        for line in [
            "info a",
            "check a",
            "convert a -o b",
            "compare a b",
            "render a -o b",
            "simplify a -o b --triangles 7",
        ] {
            let line = format!("ravec mesh {line}");
            let parsed = Arguments::parse_from(line.split(' '));
            let Command::Mesh { command, limits } = parsed.command else {
                panic!("not mesh");
            };
            let memory = MemoryBudget::default();
            assert_eq!(limits.limits(memory), MeshLimits::default());
            match command {
                MeshCommand::Info { params, .. } => assert_eq!(params, info::Params::default()),
                MeshCommand::Check { params, .. } => assert_eq!(params, check::Params::default()),
                MeshCommand::Convert { params, .. } => {
                    assert_eq!(params, convert::Params::default());
                }
                MeshCommand::Compare { params, .. } => {
                    assert_eq!(params, mesh_compare::Params::default());
                }
                MeshCommand::Render { params, .. } => {
                    assert_eq!(params, render::Params::default());
                }
                MeshCommand::Simplify { params, .. } => {
                    let goal = Some(7);
                    let triangles = simplify::Params {
                        triangles: goal,
                        ..simplify::Params::default()
                    };
                    assert_eq!(params, triangles);
                }
            }
        }
    }
}
