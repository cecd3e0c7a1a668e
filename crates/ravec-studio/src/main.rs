//! The program `ravec-studio`.

use clap::Parser;
use ravec_studio::{Studio, autosave};
use std::path::PathBuf;

/// Work on pictures, meshes and clips by hand: operations of Ravec as tools, with undo without end
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Pictures, meshes, clips or projects to open
    files: Vec<PathBuf>,
}

fn main() -> eframe::Result {
    let Arguments { files } = Arguments::parse();
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Ravec Studio")
            .with_inner_size([1280.0, 820.0])
            .with_drag_and_drop(true),
        ..eframe::NativeOptions::default()
    };
    let folder = autosave::default_folder();
    eframe::run_native(
        "ravec-studio",
        options,
        Box::new(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, folder.as_deref());
            for file in &files {
                studio.open(file);
            }
            Ok(Box::new(studio))
        }),
    )
}
