//! The operations on meshes.

use super::count;
use crate::help;
use clap::{ArgGroup, Args, Subcommand};
use ravec::memory::MemoryBudget;
use ravec_jobs::mesh::{MeshLimits, check, compare, convert, info, render, simplify};
use std::path::{Path, PathBuf};

/// The operations on meshes.
#[derive(Debug, Subcommand)]
pub enum MeshCommand {
    /// Print counts, size, area and volume of a mesh
    #[command(after_help = help::mesh::INFO)]
    Info {
        /// Input mesh; `-` is standard input
        input: PathBuf,
        #[command(flatten)]
        params: info::Params,
    },
    /// Check a mesh for defects and locate them; the exit code is 1 if there are any
    #[command(after_help = help::mesh::CHECK)]
    Check {
        /// Input mesh; `-` is standard input
        input: PathBuf,
        #[command(flatten)]
        params: check::Params,
    },
    /// Write a mesh in another format, unit or precision
    #[command(after_help = help::mesh::CONVERT)]
    Convert {
        /// Input mesh; `-` is standard input
        input: PathBuf,
        /// Output mesh; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        params: convert::Params,
    },
    /// Measure the distance between two surfaces, both ways, with proved bounds
    #[command(after_help = help::mesh::COMPARE)]
    Compare {
        /// Reference; `-` is standard input
        a: PathBuf,
        /// Mesh to compare with it; `-` is standard input
        b: PathBuf,
        #[command(flatten)]
        params: compare::Params,
    },
    /// Render a mesh to a picture
    #[command(after_help = help::mesh::RENDER)]
    Render {
        /// Input mesh; `-` is standard input
        input: PathBuf,
        /// Output picture; its extension selects the format, `-` is standard output as PNG
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// Color each place by its distance to this mesh; `-` is standard input
        #[arg(long, value_name = "MESH")]
        compare: Option<PathBuf>,
        #[command(flatten)]
        params: render::Params,
    },
    /// Simplify a mesh: feature edges are kept, and no new intersections appear
    #[command(
        after_help = help::mesh::SIMPLIFY,
        group = ArgGroup::new("goal").args(["triangles", "error"]).required(true).multiple(true)
    )]
    Simplify {
        /// Input mesh; `-` is standard input
        input: PathBuf,
        /// Output mesh; its extension selects the format, `-` is standard output in the input's format
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        params: simplify::Params,
    },
}

impl MeshCommand {
    /// The files that the operation reads.
    pub fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Compare { a, b, .. } => vec![a, b],
            Self::Render { input, compare, .. } => {
                let compare = compare.as_deref();
                std::iter::once(input.as_path()).chain(compare).collect()
            }
            Self::Info { input, .. }
            | Self::Check { input, .. }
            | Self::Convert { input, .. }
            | Self::Simplify { input, .. } => vec![input],
        }
    }

    /// The files that the operation writes.
    pub fn outputs(&self) -> Vec<&Path> {
        match self {
            Self::Convert { output, .. }
            | Self::Render { output, .. }
            | Self::Simplify { output, .. } => vec![output],
            Self::Info { .. } | Self::Check { .. } | Self::Compare { .. } => Vec::new(),
        }
    }
}

/// Limits for reading a mesh.
#[derive(Debug, Args)]
#[command(next_help_heading = "Limits")]
pub struct MeshLimitFlags {
    /// Maximum number of triangles of an input mesh; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = MeshLimits::default().max_triangles)]
    pub max_triangles: u64,
    /// Maximum number of vertices of an input mesh; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = MeshLimits::default().max_vertices)]
    pub max_vertices: u64,
}

impl MeshLimitFlags {
    /// The limits for reading with memory of `memory`.
    pub fn limits(&self, memory: MemoryBudget) -> MeshLimits {
        MeshLimits {
            memory,
            max_triangles: self.max_triangles,
            max_vertices: self.max_vertices,
        }
    }
}
