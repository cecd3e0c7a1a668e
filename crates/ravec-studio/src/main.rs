//! The program `ravec-studio`.

use clap::Parser;
use ravec_studio::measure::{Script, Stage, measure};
use ravec_studio::{Controls, Studio, autosave, choose_device};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Work on pictures, meshes and clips by hand: operations of Ravec as tools, with undo without end
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Pictures, meshes, clips or projects to open
    files: Vec<PathBuf>,
    /// Device for two-color pixels and warps: `cpu`, `gpu` for a hardware adapter, `auto` for one if there is one, or part of the
    /// name of an adapter. A hardware adapter of the window draws meshes in any case, a software driver only if it is named
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    device: String,
    /// Play the gestures of a script without a window, and print the times from event to shown picture
    #[arg(long, value_name = "SCRIPT.json", conflicts_with = "files")]
    measure: Option<PathBuf>,
    /// Print the figures as JSON
    #[arg(long, requires = "measure")]
    json: bool,
    /// Play the script in a window, on the adapter at hand
    #[arg(long, requires = "measure")]
    window: bool,
    /// Write the pictures that the script takes of the window into this folder
    #[arg(long, value_name = "DIR", requires = "window")]
    pictures: Option<PathBuf>,
    /// Keep a list of the controls in this file as JSON, with names and places, for programs that press them
    #[arg(long, value_name = "FILE", conflicts_with = "measure")]
    controls: Option<PathBuf>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = choose_device(&arguments.device).and_then(|()| match &arguments.measure {
        Some(script) => print_times(script, &arguments),
        None => open_window(arguments),
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("error: {reason}");
            ExitCode::FAILURE
        }
    }
}

fn print_times(path: &Path, arguments: &Arguments) -> Result<(), String> {
    let script = Script::load(path)?;
    let base = path.parent().unwrap_or(Path::new(""));
    let stage = if arguments.window {
        Stage::Window(arguments.pictures.clone())
    } else {
        Stage::Nowhere
    };
    let found = measure(&script, base, stage)?;
    if arguments.json {
        let text = serde_json::to_string_pretty(&found).map_err(|error| error.to_string())?;
        println!("{text}");
    } else {
        print!("{found}");
    }
    Ok(())
}

fn open_window(arguments: Arguments) -> Result<(), String> {
    let Arguments {
        files, controls, ..
    } = arguments;
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Ravec Studio")
            .with_inner_size([1280.0, 820.0])
            .with_drag_and_drop(true),
        ..eframe::NativeOptions::default()
    };
    let folder = autosave::default_folder();
    let run = eframe::run_native(
        "ravec-studio",
        options,
        Box::new(move |context| {
            if let Some(file) = controls {
                Controls::watch(&context.egui_ctx, Some(file));
            }
            let mut studio = Studio::new(&context.egui_ctx, folder.as_deref());
            studio.draw_meshes_on(context.wgpu_render_state.as_ref());
            for file in &files {
                studio.open(file);
            }
            Ok(Box::new(studio))
        }),
    );
    run.map_err(|error| format!("there is no window: {error}"))
}
