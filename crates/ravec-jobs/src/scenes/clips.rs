//! Clips as folders: numbered frames, alpha, plates and truth, one frame in memory at a time.

use super::{Scenes, Subject};
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::report::Report;
use ravec::progress::Phase;
use ravec::raster::{Image, Srgb};
use ravec_media::Picture;
use ravec_scenes::Seed;
use ravec_scenes::clip::{Clip, ClipId, Frame, clip};
use std::io;
use std::path::Path;

impl Scenes {
    /// Writes the frames of a clip, then its truth: a folder with `truth.json` is complete.
    pub(super) fn write_clip(
        &self,
        id: ClipId,
        phase: &Phase,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let params = &self.params;
        let size = params.size_of(Subject::Clip(id));
        let frames = params.frames_of(id);
        let mut clip = report.time("draw", || clip(id, size, frames, Seed(params.seed)));
        clip.noise_sigma = params.noise_sigma;
        let folder = self.out.join(id.name());
        let (alpha, plate) = (folder.join("alpha"), folder.join("plate"));
        files::make_folder(&folder)?;
        for (wanted, folder) in [(params.alpha, &alpha), (params.plate, &plate)] {
            if wanted {
                files::make_folder(folder)?;
            }
        }
        let (options, extension) = self.options();
        for index in 0..frames {
            context.progress.check()?;
            let frame = report.time("draw", || clip.frame(index));
            let mut write = |folder: &Path, image: Image<Srgb<u8>>, extension: &str| {
                let path = folder.join(format!("frame_{index:05}.{extension}"));
                let picture = Picture::from_image(image);
                files::write(&path, &picture, &options, report, context)
            };
            write(&folder, frame.stored(), extension)?;
            if params.alpha {
                // measured, not seen: never as JPEG
                write(&alpha, gray_of_alpha(&frame), "png")?;
            }
            if params.plate {
                write(&plate, frame.plate.convert(), extension)?;
            }
            phase.advance(1);
        }
        let path = folder.join("truth.json");
        files::write_output_with(&path, "JSON", report, |writer| write_truth(&clip, writer))
    }
}

/// Alpha as a gray picture: 255 times alpha, not encoded.
fn gray_of_alpha(frame: &Frame) -> Image<Srgb<u8>> {
    frame
        .alpha
        .map(|alpha| Srgb([(alpha * 255.0).round() as u8; 3]))
}

/// Writes the truth of a clip, a line for each frame.
fn write_truth(clip: &Clip, writer: &mut dyn io::Write) -> io::Result<()> {
    let head = serde_json::to_string(&clip.head())?;
    // the list of frames is the last field, and empty
    let open = head
        .strip_suffix("]}")
        .ok_or_else(|| io::Error::other("the truth of a clip must end with its list of frames"))?;
    writeln!(writer, "{open}")?;
    let frames = clip.frames();
    for index in 0..frames {
        let comma = if index + 1 < frames { "," } else { "" };
        serde_json::to_writer(&mut *writer, &clip.frame_truth(index))?;
        writeln!(writer, "{comma}")?;
    }
    writeln!(writer, "]}}")
}
