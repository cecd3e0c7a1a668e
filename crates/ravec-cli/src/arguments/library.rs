//! The operations on catalogues of photos.

use crate::help;
use clap::{Args, Subcommand};
use ravec_jobs::catalogue::{CleanParams, ListParams, Plain};
use std::path::{Path, PathBuf};

/// The operations on catalogues of photos.
#[derive(Debug, Subcommand)]
pub enum LibraryCommand {
    /// Add photos and folders to a catalogue, which is created if it is missing
    #[command(after_help = help::library::ADD)]
    Add {
        /// Photos, and folders with everything below them
        #[arg(required = true)]
        paths: Vec<PathBuf>,
        #[command(flatten)]
        catalogue: CatalogueFlag,
        #[command(flatten)]
        params: Plain,
    },
    /// Remove photos and folders from a catalogue; the files stay
    #[command(after_help = help::library::REMOVE)]
    Remove {
        /// Photos, and folders with everything below them
        #[arg(required = true)]
        paths: Vec<PathBuf>,
        #[command(flatten)]
        catalogue: CatalogueFlag,
        #[command(flatten)]
        params: Plain,
    },
    /// Print the photos as JSON
    #[command(after_help = help::library::LIST)]
    List {
        #[command(flatten)]
        catalogue: CatalogueFlag,
        #[command(flatten)]
        params: ListParams,
    },
    /// Exclude photos that are not worth a tile, and print them as JSON with the reason
    #[command(after_help = help::library::CLEAN)]
    Clean {
        #[command(flatten)]
        catalogue: CatalogueFlag,
        #[command(flatten)]
        params: CleanParams,
    },
    /// Print counts of a catalogue
    #[command(after_help = help::library::STATS)]
    Stats {
        #[command(flatten)]
        catalogue: CatalogueFlag,
        #[command(flatten)]
        params: Plain,
    },
}

impl LibraryCommand {
    /// The files and folders that the operation reads, the catalogue among them.
    pub fn inputs(&self) -> Vec<&Path> {
        let paths: &[PathBuf] = match self {
            Self::Add { paths, .. } => paths,
            // what is forgotten is not read
            Self::Remove { .. } | Self::List { .. } | Self::Clean { .. } | Self::Stats { .. } => {
                &[]
            }
        };
        let catalogue = std::iter::once(self.catalogue());
        catalogue
            .chain(paths.iter().map(PathBuf::as_path))
            .collect()
    }

    /// The catalogue.
    pub fn catalogue(&self) -> &Path {
        match self {
            Self::Add { catalogue, .. }
            | Self::Remove { catalogue, .. }
            | Self::List { catalogue, .. }
            | Self::Clean { catalogue, .. }
            | Self::Stats { catalogue, .. } => &catalogue.catalogue,
        }
    }
}

/// Which catalogue.
#[derive(Debug, Args)]
pub struct CatalogueFlag {
    /// The catalogue, one file
    #[arg(long, value_name = "FILE")]
    pub catalogue: PathBuf,
}
