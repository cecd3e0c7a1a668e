//! Reading frames of a file.

use super::ReadSeek;
use super::atom::{Fields, child, children, damaged, text_of};
use super::matrix::rotation_of;
use super::movie::{Movie, Track};
use super::timeline::{Step, Timeline};
use crate::color::ColorInfo;
use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::h264::{AvcConfig, AvcDecoder, Crop, Sps, Vui, decoder_bytes};
use crate::info::{ClipInfo, Container, PixelKind, Rotation, TrackKind};
use crate::limits::VideoLimits;
use crate::source::{Damage, FrameSource};
use crate::time::{FrameTime, Rational};
use crate::turn::{is_quarter, turned_color, turned_format, turned_planes, turned_size};
use crate::yuv::{YuvFormat, YuvImage};
use ravec_memory::Reservation;
use ravec_raster::Size;
use std::collections::BTreeMap;
use std::io::{Read as _, SeekFrom};
use std::ops::Range;

/// Frames that may wait for one that is shown before them: the references of H.264, and one.
const MAX_WAITING: usize = 17;

/// Bytes of the largest sample that is read: eight times what level 5.2 allows for a picture.
const MAX_SAMPLE_BYTES: u32 = 64 << 20;

/// Bytes of a visual sample entry before its atoms.
const VISUAL_ENTRY: usize = 78;

/// Frames of an MP4 or QuickTime file with H.264, in the order of display.
///
/// Guarantees and limits: see the [module page](super).
pub struct Mp4Source {
    input: Box<dyn ReadSeek>,
    file_length: u64,
    info: ClipInfo,
    timeline: Timeline,
    config: AvcConfig,
    sps: Sps,
    shape: Shape,
    decoder: Option<AvcDecoder>,
    /// Frames that were decoded before their turn.
    waiting: BTreeMap<u32, YuvImage>,
    next_frame: u64,
    next_step: usize,
    sample: Vec<u8>,
    damage: Option<Damage>,
    _memory: Reservation,
}

/// The way from coded to shown frames.
#[derive(Debug, Clone, Copy)]
struct Shape {
    crop: Crop,
    /// Meaning of the samples as coded.
    color: ColorInfo,
    rotation: Rotation,
}

impl Mp4Source {
    /// Opens a file at its first frame.
    ///
    /// # Errors
    /// [`VideoError::Empty`]; [`VideoError::UnknownFormat`] for another format; [`VideoError::NoVideo`] without a video track;
    /// [`VideoError::Damaged`] if no frame can be read; [`VideoError::Unsupported`], which names the codec or the property, for
    /// what is left to FFmpeg; [`VideoError::TooManyPixels`], [`VideoError::TooManyFrames`] and [`VideoError::OverBudget`]
    /// before memory is taken.
    pub fn open(
        input: impl std::io::Read + std::io::Seek + Send + 'static,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        let mut input: Box<dyn ReadSeek> = Box::new(input);
        let movie = Movie::read(&mut *input, &limits.pictures.memory)?;
        let number = movie.video_track().ok_or_else(|| no_video(&movie))?;
        let track = &movie.tracks[number];
        if !track.self_contained {
            return Err(unsupported("a clip whose frames are in another file"));
        }
        let timeline = Timeline::of(&movie, track, limits)?;
        let entry = track
            .entries
            .get(timeline.entry.wrapping_sub(1) as usize)
            .ok_or_else(|| damaged("its samples have no description"))?;
        let entry = VideoEntry::parse(&movie.bytes, entry, track)?;
        let mut source = Self::assemble(input, &movie, number, timeline, entry, limits)?;
        source.check_start()?;
        Ok(source)
    }

    fn assemble(
        input: Box<dyn ReadSeek>,
        movie: &Movie,
        number: usize,
        timeline: Timeline,
        entry: VideoEntry,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        let track = &movie.tracks[number];
        let VideoEntry {
            config,
            sps,
            clean,
            pixel_aspect,
            colors,
        } = entry;
        let (coded_width, coded_height) = sps.coded_size();
        limits.check_size(u64::from(coded_width), u64::from(coded_height))?;
        let crop = crop_of(&sps, clean)?;
        let rotation = rotation_of(&track.matrix).ok_or_else(|| {
            unsupported("a clip that is mirrored, or turned by other than quarter turns")
        })?;
        let stored =
            Size::new(crop.width, crop.height).map_err(|_| damaged("its frames have no pixels"))?;
        let mut color = ColorInfo::guess(crop.height);
        if let Some(colors) = colors {
            colors.apply(&mut color);
        }
        if let Some(vui) = &sps.vui {
            vui.apply(&mut color);
        }
        let pixel_aspect = pixel_aspect
            .or(sps.vui.and_then(|vui| vui.pixel_aspect))
            .unwrap_or(Rational::ONE);
        let format = YuvFormat::YUV420P8;
        let waiting = (MAX_WAITING as u64 + 1) * format.frame_bytes(stored);
        let memory = limits
            .pictures
            .memory
            .reserve(decoder_bytes(coded_width, coded_height) + waiting)?;
        let info = ClipInfo {
            container: Container::Mp4,
            codec: "h264".to_owned(),
            size: turned_size(stored, rotation),
            rotation,
            pixels: PixelKind::Yuv {
                format: turned_format(format, rotation)
                    .ok_or_else(|| unsupported("a clip of this layout that is turned"))?,
                color: turned_color(color, rotation),
            },
            pixel_aspect: if is_quarter(rotation) {
                pixel_aspect.recip()
            } else {
                pixel_aspect
            },
            time_base: Rational::new(1, track.timescale)
                .ok_or_else(|| damaged("its clock stands still"))?,
            rate: timeline.rate(track.timescale),
            variable_rate: Some(!timeline.even()),
            frames: Some(timeline.shown.len() as u64),
            duration: Some(timeline.duration()),
            other_tracks: movie.other_tracks(Some(number)),
        };
        Ok(Self {
            input,
            file_length: movie.file_length,
            info,
            timeline,
            config,
            sps,
            shape: Shape {
                crop,
                color,
                rotation,
            },
            decoder: None,
            waiting: BTreeMap::new(),
            next_frame: 0,
            next_step: 0,
            sample: Vec::new(),
            damage: None,
            _memory: memory,
        })
    }

    /// Refuses a clip whose first frame cannot be decoded, as an error rather than as a clip of no frames.
    fn check_start(&mut self) -> Result<(), VideoError> {
        let first = self.timeline.steps[0];
        if self.timeline.shown.is_empty() {
            return Err(damaged("its edit list shows no frame"));
        }
        if first.size > MAX_SAMPLE_BYTES || !self.read_sample(first)? {
            return Err(damaged("it ends before its first frame"));
        }
        if !self.config.starts_at(&self.sample) {
            return Err(unsupported("H.264 that does not start with a key frame"));
        }
        Ok(())
    }

    /// Reads a sample; false if the file ends before.
    fn read_sample(&mut self, step: Step) -> Result<bool, VideoError> {
        let size = u64::from(step.size);
        if step
            .offset
            .checked_add(size)
            .is_none_or(|end| end > self.file_length)
        {
            return Ok(false);
        }
        self.input.seek(SeekFrom::Start(step.offset))?;
        self.sample.clear();
        (&mut self.input).take(size).read_to_end(&mut self.sample)?;
        Ok(self.sample.len() as u64 == size)
    }

    /// Decodes the next sample. `Err` of the inner result is the damage.
    fn decode_step(&mut self) -> Result<Result<(), String>, VideoError> {
        let Some(&step) = self.timeline.steps.get(self.next_step) else {
            return Ok(Err("a frame is missing".to_owned()));
        };
        let number = self.next_step;
        if step.size > MAX_SAMPLE_BYTES {
            return Ok(Err(format!("frame {} has {} bytes", number + 1, step.size)));
        }
        if !self.read_sample(step)? {
            return Ok(Err(format!(
                "the file ends before the data of frame {}",
                number + 1
            )));
        }
        let decoder = match &mut self.decoder {
            Some(decoder) => decoder,
            empty => match AvcDecoder::new(&self.config, &self.sps) {
                Ok(decoder) => empty.insert(decoder),
                Err(reason) => return Ok(Err(reason)),
            },
        };
        self.next_step += 1;
        let rank = step
            .rank()
            .filter(|&rank| u64::from(rank) >= self.next_frame);
        let wanted = rank.map(|_| (self.shape.crop, self.shape.color));
        match (decoder.decode(&self.sample, wanted), rank) {
            (Err(reason), _) => Ok(Err(format!(
                "frame {} in the order of the file: {reason}",
                number + 1
            ))),
            (Ok(Some(frame)), Some(rank)) => {
                // the layout has a turned one, as was found when the clip was opened
                let upright = match self.shape.rotation {
                    Rotation::None => frame,
                    rotation => turned_planes(&frame, rotation).unwrap_or(frame),
                };
                self.waiting.insert(rank, upright);
                if self.waiting.len() > MAX_WAITING {
                    return Ok(Err("frames are stored too far from their turn".to_owned()));
                }
                Ok(Ok(()))
            }
            _ => Ok(Ok(())),
        }
    }

    /// The sample at which decoding has to start for a frame.
    fn start_for(&mut self, step: usize) -> Result<usize, VideoError> {
        let mut at = step;
        loop {
            // a file may call a picture a start that needs earlier ones; the data do not
            if at == 0
                || self.timeline.steps[at].sync()
                    && self.read_sample(self.timeline.steps[at])?
                    && self.config.starts_at(&self.sample)
            {
                return Ok(at);
            }
            at -= 1;
        }
    }
}

impl FrameSource for Mp4Source {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let Some(&shown) = usize::try_from(self.next_frame)
            .ok()
            .and_then(|frame| self.timeline.shown.get(frame))
        else {
            return Ok(None);
        };
        let rank = self.next_frame as u32;
        loop {
            if let Some(picture) = self.waiting.remove(&rank) {
                self.next_frame += 1;
                let time = FrameTime {
                    start: shown.start,
                    duration: shown.duration,
                };
                return Ok(Some(Frame {
                    picture: FramePicture::Yuv(picture),
                    time,
                }));
            }
            if self.damage.is_some() {
                return Ok(None);
            }
            if let Err(reason) = self.decode_step()? {
                self.damage = Some(Damage {
                    frames: self.next_frame,
                    reason,
                    lost: None,
                });
            }
        }
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        let target = usize::try_from(index)
            .ok()
            .and_then(|frame| self.timeline.shown.get(frame));
        let Some(target) = target else {
            self.next_frame = self.timeline.shown.len() as u64;
            return Ok(());
        };
        let step = target.step as usize;
        let start = self.start_for(step)?;
        let forward = self.decoder.is_some()
            && index >= self.next_frame
            && self.next_step >= start
            && self.damage.is_none();
        self.next_frame = index;
        if forward {
            self.waiting = self.waiting.split_off(&(index as u32));
            if self.next_step <= step || self.waiting.contains_key(&(index as u32)) {
                return Ok(());
            }
        }
        self.waiting.clear();
        self.decoder = None;
        self.next_step = start;
        self.damage = None;
        Ok(())
    }

    fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }
}

fn unsupported(feature: &str) -> VideoError {
    VideoError::Unsupported {
        feature: feature.to_owned(),
        hint: None,
    }
}

/// The tracks of a file without video, in words.
fn no_video(movie: &Movie) -> VideoError {
    let others = movie.other_tracks(None);
    let count = |wanted: TrackKind, word: &str| match others
        .iter()
        .filter(|track| track.kind == wanted)
        .count()
    {
        0 => None,
        1 => Some(format!("1 {word} track")),
        count => Some(format!("{count} {word} tracks")),
    };
    let parts: Vec<String> = [
        count(TrackKind::Audio, "audio"),
        count(TrackKind::Subtitles, "subtitle"),
        count(TrackKind::Data, "data"),
    ]
    .into_iter()
    .flatten()
    .collect();
    let tracks = if parts.is_empty() {
        "no track at all".to_owned()
    } else {
        parts.join(", ")
    };
    VideoError::NoVideo { tracks }
}

/// The sample entry of a video track.
struct VideoEntry {
    config: AvcConfig,
    sps: Sps,
    /// Content of `clap`: what of the frame is shown.
    clean: Option<[i64; 8]>,
    pixel_aspect: Option<Rational>,
    colors: Option<Vui>,
}

impl VideoEntry {
    fn parse(
        bytes: &[u8],
        (kind, body): &([u8; 4], Range<usize>),
        track: &Track,
    ) -> Result<Self, VideoError> {
        match kind {
            b"avc1" | b"avc2" | b"avc3" | b"avc4" => {}
            b"encv" => return Err(unsupported("encrypted video")),
            _ => return Err(unsupported(&format!("the codec {}", track.codec()))),
        }
        let atoms = (body.start + VISUAL_ENTRY).min(body.end)..body.end;
        let content = |kind| child(bytes, atoms.clone(), kind).map(|body| &bytes[body]);
        let config = content(*b"avcC")
            .and_then(AvcConfig::parse)
            .ok_or_else(|| {
                damaged(format!(
                    "the description of its codec (atom `{}`) is cut",
                    text_of(*kind)
                ))
            })?;
        let Some(set) = config.sps.first() else {
            return Err(unsupported("H.264 without parameter sets in the header"));
        };
        let sets: Option<Vec<Sps>> = config.sps.iter().map(|set| Sps::parse(set)).collect();
        let (Some(sps), Some(sets)) = (Sps::parse(set), sets) else {
            return Err(damaged("a parameter set of its codec is cut"));
        };
        for set in &sets {
            if let Some(feature) = set.unsupported() {
                return Err(unsupported(&feature));
            }
            if !set.same_pictures(&sps) {
                return Err(unsupported("a clip that changes its size midway"));
            }
        }
        Ok(Self {
            config,
            sps,
            clean: content(*b"clap").and_then(read_clean),
            pixel_aspect: content(*b"pasp").and_then(|body| {
                let mut fields = Fields(body);
                Rational::new(fields.u32()?, fields.u32()?).map(Rational::reduced)
            }),
            colors: children(bytes, atoms.clone())
                .filter(|(kind, _)| kind == b"colr")
                .find_map(|(_, body)| read_colors(&bytes[body])),
        })
    }
}

/// Numerators and denominators of width, height and the two offsets.
fn read_clean(body: &[u8]) -> Option<[i64; 8]> {
    let mut fields = Fields(body);
    let mut numbers = [0; 8];
    for number in &mut numbers {
        *number = i64::from(fields.i32()?);
    }
    Some(numbers)
}

fn read_colors(body: &[u8]) -> Option<Vui> {
    let mut fields = Fields(body);
    let kind = fields.take(4)?;
    if kind != b"nclx" && kind != b"nclc" {
        return None;
    }
    let mut code = || Some(u8::try_from(fields.u16()?).unwrap_or(2));
    let color = Some([code()?, code()?, code()?]);
    let full_range = if kind == b"nclx" {
        fields.u8().map(|flags| flags & 0x80 != 0)
    } else {
        None
    };
    Some(Vui {
        full_range,
        color,
        ..Default::default()
    })
}

/// The part of a coded frame that the parameter set and `clap` show. A `clap` off the grid of chroma is ignored.
fn crop_of(sps: &Sps, clean: Option<[i64; 8]>) -> Result<Crop, VideoError> {
    let [col, row, width, height] = sps
        .cropped_size()
        .ok_or_else(|| damaged("its frames have no pixels"))?
        .map(|side| side as usize);
    let whole = Crop {
        col,
        row,
        width,
        height,
    };
    let inner = clean.and_then(|[w, w_den, h, h_den, x, x_den, y, y_den]| {
        let (col, width) = clean_side(width, (w, w_den), (x, x_den))?;
        let (row, height) = clean_side(height, (h, h_den), (y, y_den))?;
        Some(Crop {
            col: whole.col + col,
            row: whole.row + row,
            width,
            height,
        })
    });
    Ok(inner.unwrap_or(whole))
}

/// First sample and length along an axis: the offset is that of the middle.
fn clean_side(
    full: usize,
    (num, den): (i64, i64),
    (off_num, off_den): (i64, i64),
) -> Option<(usize, usize)> {
    if den < 1 || off_den < 1 || num % den != 0 {
        return None;
    }
    let length = num / den;
    let full = i64::try_from(full).ok()?;
    // twice the first sample: full - length + 2 * offset
    let twice = (full - length)
        .checked_mul(off_den)?
        .checked_add(off_num.checked_mul(2)?)?;
    if twice % (2 * off_den) != 0 {
        return None;
    }
    let first = twice / (2 * off_den);
    let fits = length > 0 && first >= 0 && first % 2 == 0 && first + length <= full;
    fits.then_some((first as usize, length as usize))
}
