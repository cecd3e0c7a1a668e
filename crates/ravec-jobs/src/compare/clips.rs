//! Clips compared frame by frame.

use super::{Compare, record};
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation as _;
use crate::report::Report;
use crate::video::{open_clip, read_error};
use ravec::raster::{Comparison, LinearRgba, MetricError, compare_with_progress, with_image};
use ravec_video::{Clip, FrameSource as _};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::time::Instant;

/// Compares two clips in the order of their frames.
///
/// # Errors
/// [`JobError::ReadClip`], [`JobError::SizesDiffer`], [`JobError::Cancelled`].
pub(super) fn compare_clips(operation: &Compare, context: &Context) -> Result<Report, JobError> {
    let Compare { a, b, plot, params } = operation;
    let mut report = Report::of(operation, params);
    let mut clip_a = open_clip(a, None, &mut report, context)?;
    let mut clip_b = open_clip(b, None, &mut report, context)?;
    for output in operation.outputs() {
        report.check_output(output)?;
    }
    let differ = || JobError::SizesDiffer {
        a: a.clone(),
        a_size: clip_a.info().size,
        b: b.clone(),
        b_size: clip_b.info().size,
    };
    if clip_a.info().size != clip_b.info().size {
        return Err(differ());
    }
    let start = Instant::now();
    let total = clip_a.info().frames.or(clip_b.info().frames).unwrap_or(1);
    let phase = context.progress.phase("frames", total);
    let inner = context.progress.silent();
    let mut found: Vec<(f64, Comparison)> = Vec::new();
    let mut extra = 0u64;
    let base = clip_a.info().time_base.to_f64();
    loop {
        context.progress.check()?;
        let frame_a = clip_a.next_frame().map_err(read_error(a))?;
        let frame_b = clip_b.next_frame().map_err(read_error(b))?;
        let (frame_a, frame_b) = match (frame_a, frame_b) {
            (Some(frame_a), Some(frame_b)) => (frame_a, frame_b),
            (None, None) => break,
            (left, right) => {
                // only one of the two goes on
                let clip = if left.is_some() {
                    &mut clip_a
                } else {
                    &mut clip_b
                };
                drop(right);
                extra = 1 + rest(clip, operation, context)?;
                break;
            }
        };
        let (image_a, image_b) = (frame_a.picture.to_image(), frame_b.picture.to_image());
        let image_b = image_b.convert::<LinearRgba>();
        let compared =
            with_image!(&*image_a, image_a => compare_with_progress(image_a, &image_b, &inner));
        let comparison = compared.map_err(|error| match error {
            MetricError::Cancelled(_) => JobError::Cancelled,
            _ => JobError::SizesDiffer {
                a: a.clone(),
                a_size: image_a.size(),
                b: b.clone(),
                b_size: image_b.size(),
            },
        })?;
        found.push((frame_a.time.start as f64 * base, comparison));
        phase.advance(1);
    }
    for (path, clip) in [(a, &clip_a), (b, &clip_b)] {
        if let Some(damage) = clip.damage() {
            report.record_dropped(format!("{}: {damage}", path.display()));
        }
    }
    if extra > 0 {
        report.record_dropped(format!(
            "one clip has {extra} more frames, which are not compared"
        ));
    }
    if found.is_empty() {
        return Err(JobError::EmptyRange {
            path: a.clone(),
            range: "..".to_owned(),
        });
    }
    report.add_time("frames", start);
    record(&over_all(&found), &mut report);
    let least = |of: fn(&Comparison) -> f64| {
        found
            .iter()
            .map(|(_, c)| of(c))
            .fold(f64::INFINITY, f64::min)
    };
    report.figures.insert("min_psnr_db", least(|c| c.psnr_db));
    report.figures.insert("min_ssim", least(|c| c.ssim));
    report.figures.insert("frames", found.len() as f64);
    report.figures.insert("extra_frames", extra as f64);
    report.result = Some(found.iter().enumerate().map(entry).collect());
    if let Some(path) = plot {
        let text = plotted(&found);
        files::write_output_text(path, "SVG", &text, &mut report, context)?;
    }
    Ok(report)
}

/// Counts the frames that are left.
fn rest(clip: &mut Clip, operation: &Compare, context: &Context) -> Result<u64, JobError> {
    let mut count = 0;
    while clip
        .next_frame()
        .map_err(read_error(&operation.a))?
        .is_some()
    {
        context.progress.check()?;
        count += 1;
    }
    Ok(count)
}

fn entry((at, (seconds, found)): (usize, &(f64, Comparison))) -> Value {
    json!({
        "frame": at,
        "seconds": seconds,
        "psnr_db": found.psnr_db,
        "ssim": found.ssim,
        "delta_e_mean": found.delta_e_mean,
        "delta_e_p95": found.delta_e_p95,
        "identical": found.identical,
    })
}

/// The figures over all frames.
fn over_all(found: &[(f64, Comparison)]) -> Comparison {
    let mean = |of: &dyn Fn(&Comparison) -> f64| {
        found.iter().map(|(_, c)| of(c)).sum::<f64>() / found.len() as f64
    };
    let largest =
        |of: &dyn Fn(&Comparison) -> f64| found.iter().map(|(_, c)| of(c)).fold(0.0, f64::max);
    let error = mean(&|c| 10f64.powf(-c.psnr_db / 10.0));
    Comparison {
        psnr_db: -10.0 * error.log10(),
        ssim: mean(&|c| c.ssim),
        delta_e_mean: mean(&|c| c.delta_e_mean),
        delta_e_p95: largest(&|c| c.delta_e_p95),
        delta_e_max: largest(&|c| c.delta_e_max),
        delta_e_oklab_mean: mean(&|c| c.delta_e_oklab_mean),
        max_abs: largest(&|c| c.max_abs),
        alpha_max_abs: largest(&|c| c.alpha_max_abs),
        identical: found.iter().all(|(_, c)| c.identical),
    }
}

/// Sides of the plot and of its axes' labels, in pixels.
const PLOT: [f64; 2] = [800.0, 300.0];
const MARGIN: f64 = 48.0;

/// Equal frames have an infinite PSNR, which is drawn at this height.
const CEILING_DB: f64 = 100.0;

/// The PSNR of each frame as a curve.
fn plotted(found: &[(f64, Comparison)]) -> String {
    let value = |at: usize| found[at].1.psnr_db.min(CEILING_DB);
    let low = (0..found.len()).map(value).fold(f64::INFINITY, f64::min);
    let high = (0..found.len()).map(value).fold(0.0, f64::max);
    // whole steps of 5 dB around the curve
    let (low, high) = ((low / 5.0).floor() * 5.0, (high / 5.0).floor() * 5.0 + 5.0);
    let x =
        |at: usize| MARGIN + (PLOT[0] - MARGIN - 8.0) * at as f64 / (found.len() - 1).max(1) as f64;
    let y = |db: f64| 8.0 + (PLOT[1] - MARGIN) * (high - db) / (high - low);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"12\">\n<title>PSNR of each frame</title>\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        PLOT[0], PLOT[1]
    );
    let step = if high - low > 40.0 { 10.0 } else { 5.0 };
    let mut db = low;
    while db <= high {
        // writing to a string does not fail
        let _ = writeln!(
            text,
            "<path d=\"M{MARGIN} {y:.1}H{}\" stroke=\"#ccc\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{db} dB</text>",
            PLOT[0] - 8.0,
            MARGIN - 4.0,
            y(db) + 4.0,
            y = y(db)
        );
        db += step;
    }
    let ticks = found.len().clamp(2, 9) - 1;
    for tick in 0..=ticks {
        let at = (found.len() - 1) * tick / ticks;
        let _ = writeln!(
            text,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{at}</text>",
            x(at),
            PLOT[1] - 18.0
        );
    }
    let points: Vec<String> = (0..found.len())
        .map(|at| format!("{:.1},{:.1}", x(at), y(value(at))))
        .collect();
    let _ = writeln!(
        text,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#06c\" stroke-width=\"1.5\"/>",
        points.join(" ")
    );
    text.push_str("</svg>\n");
    text
}
