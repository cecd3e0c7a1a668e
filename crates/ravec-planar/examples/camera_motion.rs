//! Camera motion of a clip, from raw gray frames on standard input.
//!
//! ```text
//! ffmpeg -v error -i clip.mp4 -f rawvideo -pix_fmt gray - |
//!     cargo run --release -p ravec-planar --example camera_motion -- 640 360
//! ```
//!
//! A line for each frame: its number, `cut` or `-`, `ok` or `?`, the share of blocks that follow the motion, the residual in 255
//! steps, the deviation of the corners, the largest motion of a corner since the previous frame and since the beginning of the
//! shot (all in pixels), and the mean difference to the previous frame in 255 steps, as it is and after the motion is taken out.
//! The last line sums them up.

use glam::{DVec2, dvec2};
use ravec_planar::Homography;
use ravec_planar::camera::{CameraMotion, CameraMotionParams};
use ravec_raster::{Plane, Size};
use std::io::Read;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers: Vec<usize> = std::env::args()
        .skip(1)
        .map(|word| word.parse())
        .collect::<Result<_, _>>()?;
    let [width, height] = numbers[..] else {
        return Err("two numbers are needed: the width and the height of the frames".into());
    };
    let size = Size::new(width, height)?;
    let mut camera = CameraMotion::new(size, &CameraMotionParams::default())?;
    let mut bytes = vec![0; size.pixels()];
    let mut previous: Option<Plane> = None;
    let mut total = Total::default();
    let mut input = std::io::stdin().lock();
    while input.read_exact(&mut bytes).is_ok() {
        let luma = bytes.iter().map(|&v| f32::from(v) / 255.0).collect();
        let frame = Plane::from_vec(width, luma)?;
        let start = Instant::now();
        let reduced = camera.reduce(&frame);
        let between = Instant::now();
        let motion = camera.push_reduced(&reduced);
        total.reduce += (between - start).as_secs_f64();
        total.estimate += between.elapsed().as_secs_f64();
        let step = farthest(&motion.frame_from_previous, size);
        let [raw, stabilized] = match &previous {
            Some(previous) if !motion.cut => {
                differences(previous, &frame, &motion.frame_from_previous)
            }
            _ => [0.0; 2],
        };
        println!(
            "{:4} {:3} {:2} share {:.3} residual {:6.2} sigma {:7.3} step {:7.3} shot {:8.2} raw {:6.2} stabilized {:6.2}",
            total.frames,
            if motion.cut { "cut" } else { "-" },
            if motion.reliable { "ok" } else { "?" },
            motion.inlier_share,
            255.0 * motion.residual,
            motion.corner_sigma_px,
            step,
            farthest(&motion.frame_from_shot, size),
            raw,
            stabilized
        );
        total.add(motion.cut, motion.reliable, step, raw, stabilized);
        previous = Some(frame);
    }
    total.print();
    Ok(())
}

#[derive(Default)]
struct Total {
    frames: usize,
    cuts: Vec<usize>,
    unreliable: usize,
    still: usize,
    largest_step: f64,
    raw: f64,
    stabilized: f64,
    reduce: f64,
    estimate: f64,
}

impl Total {
    fn add(&mut self, cut: bool, reliable: bool, step: f64, raw: f64, stabilized: f64) {
        if cut {
            self.cuts.push(self.frames);
        }
        self.unreliable += usize::from(!reliable);
        self.still += usize::from(step == 0.0 && !cut);
        self.largest_step = self.largest_step.max(step);
        self.raw += raw;
        self.stabilized += stabilized;
        self.frames += 1;
    }

    fn print(&self) {
        let n = self.frames.max(1) as f64;
        println!(
            "{} frames, cuts at {:?}, {} unreliable, {} still, largest step {:.3} px, raw {:.3}, stabilized {:.3}, ms a frame: {:.2} reduction, {:.2} estimate",
            self.frames,
            self.cuts,
            self.unreliable,
            self.still,
            self.largest_step,
            self.raw / n,
            self.stabilized / n,
            1e3 * self.reduce / n,
            1e3 * self.estimate / n
        );
    }
}

/// The largest motion of a corner.
fn farthest(h: &Homography, size: Size) -> f64 {
    let (w, h_px) = (size.width() as f64, size.height() as f64);
    [(0.0, 0.0), (w, 0.0), (w, h_px), (0.0, h_px)]
        .iter()
        .map(|&(x, y)| dvec2(x, y))
        .map(|p| h.apply(p).distance(p))
        .fold(0.0, f64::max)
}

/// The mean absolute difference of two frames, before and after the first is moved, where both are seen.
fn differences(before: &Plane, after: &Plane, after_from_before: &Homography) -> [f64; 2] {
    let back = after_from_before.inverse();
    let inside = |p: DVec2| {
        p.min_element() >= 0.5
            && p.x < before.width() as f64 - 0.5
            && p.y < before.height() as f64 - 0.5
    };
    let (mut sums, mut count) = ([0.0; 2], 0);
    for row in (0..after.height()).step_by(2) {
        for col in (0..after.width()).step_by(2) {
            let at = back.apply(dvec2(col as f64 + 0.5, row as f64 + 0.5));
            if !inside(at) {
                continue;
            }
            let value = after[(col, row)];
            sums[0] += f64::from((value - before[(col, row)]).abs());
            sums[1] += f64::from((value - before.catmull_rom(at)).abs());
            count += 1;
        }
    }
    sums.map(|sum| 255.0 * sum / f64::from(count.max(1)))
}
