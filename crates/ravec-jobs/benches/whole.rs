//! Whole operations: time, rate and quality, as tables for `docs/measurements.md`.
//!
//! `cargo bench -p ravec-jobs --bench whole` measures on the built-in street; with `RAVEC_PHOTOS=DIR` the quality tables are
//! made from the PNG files in that folder instead. Names of sections (`fit`, `coarse`, `reconstruction`, `reduction`, `brush`,
//! `growth`)
//! behind `--` choose what is run. `cargo test` only compiles it.

use fearless_simd::Level;
use ravec::progress::Progress;
use ravec::raster::{Image, LinearRgba, Rect, ResizeFilter, Size, Srgb, compare, resize};
use ravec::twocolor::brush::{Brush, Stroke, Tool};
use ravec::twocolor::{
    CleanParams, FitMethod, FitParams, Mode, OperatorParams, TwoColorField, clean, operate,
    render_mosaic, render_to,
};
use ravec_media::Limits;
use ravec_scenes::Seed;
use ravec_scenes::catalog::{SceneId, render};
use ravec_scenes::street::street;
use std::time::Instant;

/// Median seconds of some runs.
fn median<T>(runs: usize, mut work: impl FnMut() -> T) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(work());
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

/// The picture repeated, mirrored at its borders, to a given size.
fn tiled(image: &Image<Srgb<u8>>, width: usize, height: usize) -> Image<Srgb<u8>> {
    let mirrored = |i: usize, len: usize| {
        let j = i % (2 * len);
        j.min(2 * len - 1 - j)
    };
    let size = Size::new(width, height).expect("sizes of the tables are positive");
    Image::from_fn(size, |col, row| {
        image[(mirrored(col, image.width()), mirrored(row, image.height()))]
    })
}

fn photos() -> Vec<Image<Srgb<u8>>> {
    let Some(folder) = std::env::var_os("RAVEC_PHOTOS") else {
        eprintln!("RAVEC_PHOTOS is not set: the street stands in for photos");
        return Vec::new();
    };
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .expect("RAVEC_PHOTOS names a folder")
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "png"))
        .collect();
    paths.sort();
    paths
        .iter()
        .filter_map(|path| ravec_media::read(path, &Limits::default()).ok())
        .map(|picture| picture.convert())
        .collect()
}

fn fit(image: &Image<Srgb<u8>>, block_px: usize, method: FitMethod) -> TwoColorField {
    let params = FitParams {
        block_px,
        method,
        ..FitParams::default()
    };
    TwoColorField::fit(image, &params, &Progress::none()).expect("the table's sides can be fitted")
}

fn main() {
    // `cargo test --benches` runs this with `--test`: compiling was the test
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let street: Image<Srgb<u8>> = street(Size::new(1536, 1024).expect("a positive size"), Seed(1))
        .0
        .convert();
    let photos = match photos() {
        photos if photos.is_empty() => vec![street.clone()],
        photos => photos,
    };
    let base = photos[0].clone();
    let sections: [(&str, &dyn Fn()); 6] = [
        ("fit", &|| exact_fit(&base)),
        ("coarse", &|| coarse_to_fine(&photos)),
        ("reconstruction", &|| reconstruction(&photos)),
        ("reduction", &|| reduction(&photos)),
        ("brush", &|| brush(&base)),
        ("growth", &|| growth(&base)),
    ];
    // `cargo bench` adds an option of its own
    let named: Vec<String> = std::env::args()
        .skip(1)
        .filter(|argument| !argument.starts_with('-'))
        .collect();
    for (name, run) in sections {
        if named.is_empty() || named.iter().any(|asked| asked == name) {
            run();
        }
    }
}

fn exact_fit(base: &Image<Srgb<u8>>) {
    let image = tiled(base, 4000, 3000);
    println!("### Exact fit, 12 megapixels, 8 bit in, colors converted\n");
    println!("| N | instruction set | ms | megapixels/s |\n|---|---|---|---|");
    for block_px in [8, 16] {
        let params = FitParams {
            block_px,
            method: FitMethod::Exact,
            ..FitParams::default()
        };
        let mut levels = vec![("widest", Level::new())];
        #[cfg(target_arch = "x86_64")]
        levels.extend(
            Level::new()
                .as_avx2()
                .map(|avx2| ("AVX2", Level::Avx2(avx2))),
        );
        levels.push(("baseline", Level::baseline()));
        for (name, level) in levels {
            let seconds = median(7, || {
                TwoColorField::fit_with(level, &image, &params, &Progress::none())
            });
            println!(
                "| {block_px} | {name} | {:.1} | {:.0} |",
                1e3 * seconds,
                12.0 / seconds
            );
        }
    }
    println!();
}

fn coarse_to_fine(photos: &[Image<Srgb<u8>>]) {
    println!(
        "### Coarse to fine against exact, {} pictures\n",
        photos.len()
    );
    println!(
        "| N | blocks | mean ratio | 99th percentile | sum ratio | speed-up |\n|---|---|---|---|---|---|"
    );
    for block_px in [16, 24, 32] {
        let (mut ratios, mut sums, mut times) = (Vec::new(), [0.0f64; 2], [0.0f64; 2]);
        for image in photos {
            let methods = [FitMethod::Exact, FitMethod::CoarseToFine];
            let fields = methods.map(|method| fit(image, block_px, method));
            for (time, method) in times.iter_mut().zip(methods) {
                *time += median(3, || fit(image, block_px, method));
            }
            for (exact, coarse) in fields[0].blocks().iter().zip(fields[1].blocks()) {
                let (exact, coarse) = (f64::from(exact.error), f64::from(coarse.error));
                sums = [sums[0] + exact, sums[1] + coarse];
                // below this the block is flat but for rounding
                if exact > 1e-5 {
                    ratios.push(coarse / exact);
                }
            }
        }
        ratios.sort_by(f64::total_cmp);
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let p99 = ratios[(ratios.len() - 1) * 99 / 100];
        println!(
            "| {block_px} | {} | {mean:.4} | {p99:.3} | {:.4} | {:.2} |",
            ratios.len(),
            sums[1] / sums[0],
            times[0] / times[1]
        );
    }
    println!();
}

fn reconstruction(photos: &[Image<Srgb<u8>>]) {
    println!(
        "### Two-color image against the mosaic of the same blocks, mean over {} pictures\n",
        photos.len()
    );
    println!(
        "| N | two-color PSNR dB | mosaic PSNR dB | gain dB | two-color SSIM | mosaic SSIM |\n|---|---|---|---|---|---|"
    );
    for block_px in [4, 8, 12, 16] {
        let mut sums = [0.0; 4];
        for image in photos {
            let progress = Progress::none();
            let lines = redrawn(image, block_px);
            let field = fit(image, block_px, FitMethod::Auto);
            let mosaic = render_mosaic(&field, image.size(), &progress).expect("nobody cancels");
            let [a, b] =
                [&lines, &mosaic].map(|result| compare(image, result).expect("sizes agree"));
            for (sum, value) in sums.iter_mut().zip([a.psnr_db, b.psnr_db, a.ssim, b.ssim]) {
                *sum += value / photos.len() as f64;
            }
        }
        let [a, b, c, d] = sums;
        println!(
            "| {block_px} | {a:.2} | {b:.2} | {:.2} | {c:.3} | {d:.3} |",
            a - b
        );
    }
    println!();
}

/// Numbers that a two-color pixel of an opaque picture holds: angle and offset of its line, and two colors.
const VALUES_PER_BLOCK: f64 = 8.0;

/// The picture drawn again from its two-color pixels, whose lines know parts of pixels.
fn redrawn(image: &Image<Srgb<u8>>, block_px: usize) -> Image<LinearRgba> {
    let progress = Progress::none();
    let mut field = fit(image, block_px, FitMethod::Auto);
    field
        .refine_lines(image, &progress)
        .expect("nobody cancels");
    render_to(&field, image.size(), &progress).expect("nobody cancels")
}

/// The picture shrunk to as many values as its two-color pixels hold, and grown again.
fn reduced(image: &Image<Srgb<u8>>, block_px: usize, filter: ResizeFilter) -> Image<Srgb<u8>> {
    let scale = (VALUES_PER_BLOCK / 3.0).sqrt() / block_px as f64;
    let side = |len: usize| (len as f64 * scale).round().max(1.0) as usize;
    let small = Size::new(side(image.width()), side(image.height())).expect("both are positive");
    let small = resize(image, small, filter);
    resize(&small, image.size(), ResizeFilter::Bilinear)
}

fn reduction(photos: &[Image<Srgb<u8>>]) {
    println!(
        "### Two-color image against a reduction to equally many values, drawn up bilinearly: SSIM\n"
    );
    println!("(the better of reductions by box and Lanczos)\n");
    println!("| picture | N = 4 | N = 8 | N = 16 |\n|---|---|---|---|");
    let mut pictures: Vec<(String, Image<Srgb<u8>>)> = SceneId::ALL
        .into_iter()
        .map(|id| {
            let scene = render(id, id.default_size(), id.default_seed());
            (id.name().to_owned(), scene.image.convert())
        })
        .collect();
    let numbered = photos.iter().enumerate();
    pictures.extend(numbered.map(|(i, photo)| (format!("photo {}", i + 1), photo.clone())));
    let (mut wins, mut count) = ([0; 3], 0);
    for (name, image) in &pictures {
        let mut cells = Vec::new();
        for (i, block_px) in [4, 8, 16].into_iter().enumerate() {
            let ours = compare(image, &redrawn(image, block_px)).expect("sizes agree");
            let theirs = [ResizeFilter::Box, ResizeFilter::Lanczos3]
                .map(|filter| compare(image, &reduced(image, block_px, filter)))
                .map(|result| result.expect("sizes agree").ssim)
                .into_iter()
                .fold(0.0, f64::max);
            wins[i] += usize::from(ours.ssim > theirs);
            cells.push(format!("{:.3} / {theirs:.3}", ours.ssim));
        }
        count += 1;
        println!("| {name} | {} |", cells.join(" | "));
    }
    println!(
        "| better on | {} |\n",
        wins.map(|wins| format!("{wins} of {count}")).join(" | ")
    );
}

fn brush(base: &Image<Srgb<u8>>) {
    let image: Image<LinearRgba> = tiled(base, 1024, 1024).convert();
    println!("### Brush, radius 64, window 9, on 1 megapixel; medians of 9\n");
    println!("| tool | one dab, ms | stroke on by 129 px, ms |\n|---|---|---|");
    let operator = |mode| Tool::Operator {
        mode,
        iterations: 1,
        noise_sigma: Some(5.0),
    };
    for (name, tool) in [
        ("abstract", operator(Mode::Abstract)),
        ("smooth", operator(Mode::Smooth)),
        ("sharpen", operator(Mode::Sharpen)),
        ("clean", operator(Mode::Clean)),
        ("antialias", operator(Mode::Antialias)),
        ("stamp", operator(Mode::Stamp)),
        ("color", Tool::Color { rgb: [200, 30, 30] }),
        ("dodge", Tool::Dodge),
        ("saturation", Tool::Saturation { amount: 0.5 }),
        ("clone", Tool::Clone { offset: [40, 0] }),
        ("mask", Tool::Mask),
    ] {
        let progress = Progress::none();
        let dab = |run: usize| {
            let at = 150.0 + 40.0 * run as f64;
            Stroke::new(tool.clone(), vec![[at, at]], 64.0)
        };
        let mut brush = Brush::begin(image.clone(), dab(0), &progress).expect("a valid stroke");
        let (mut dabs, mut steps) = (Vec::new(), Vec::new());
        for run in 0..9 {
            let start = Instant::now();
            brush
                .next_stroke(dab(run), &progress)
                .expect("a valid stroke");
            dabs.push(start.elapsed().as_secs_f64());
            let start = Instant::now();
            // a step of two radii: nothing under the new dab is known yet
            let [[x, y], ..] = brush.stroke().points[..] else {
                continue;
            };
            brush
                .extend([x + 129.0, y], &progress)
                .expect("a valid point");
            steps.push(start.elapsed().as_secs_f64());
        }
        let [dab, step] = [dabs, steps].map(|mut times| {
            times.sort_by(f64::total_cmp);
            1e3 * times[times.len() / 2]
        });
        println!("| {name} | {dab:.1} | {step:.1} |");
    }
    println!(
        "\n(a step covers a band of 129 x 128 pixels beside the new dab: about twice the dab's own area)\n"
    );
    let params = OperatorParams {
        mode: Mode::Smooth,
        ..OperatorParams::default()
    };
    let whole = Rect::of(image.size());
    let seconds = median(5, || operate(&image, whole, &params, &Progress::none()));
    println!(
        "Whole-image smooth pass of 1 megapixel: {:.0} ms\n",
        1e3 * seconds
    );
}

fn growth(base: &Image<Srgb<u8>>) {
    println!("### Nanoseconds a pixel over size\n");
    println!("| operation | 1 MP | 4 MP | 16 MP | 64 MP |\n|---|---|---|---|---|");
    let images: Vec<Image<Srgb<u8>>> = [1000, 2000, 4000, 8000]
        .map(|side| tiled(base, side, side))
        .into();
    let row = |name: &str, work: &dyn Fn(&Image<Srgb<u8>>)| {
        let cells: Vec<String> = images
            .iter()
            .map(|image| {
                let runs = if image.width() > 3000 { 3 } else { 7 };
                format!(
                    "{:.2}",
                    1e9 * median(runs, || work(image)) / image.size().pixels() as f64
                )
            })
            .collect();
        println!("| {name} | {} |", cells.join(" | "));
    };
    row("fit, N = 8", &|image| drop(fit(image, 8, FitMethod::Auto)));
    row("fit, N = 16", &|image| {
        drop(fit(image, 16, FitMethod::Auto));
    });
    row("fit, N = 32", &|image| {
        drop(fit(image, 32, FitMethod::Auto));
    });
    let clean_params = CleanParams {
        noise_sigma: Some(10.0),
        ..CleanParams::default()
    };
    row("clean", &|image| {
        drop(clean(
            image,
            Rect::of(image.size()),
            &clean_params,
            &Progress::none(),
        ));
    });
    let smooth = OperatorParams::default();
    row("smooth", &|image| {
        drop(operate(
            image,
            Rect::of(image.size()),
            &smooth,
            &Progress::none(),
        ));
    });
    let fields: Vec<TwoColorField> = images
        .iter()
        .map(|image| fit(image, 8, FitMethod::Auto))
        .collect();
    row("render, N = 8", &|image| {
        let field = fields
            .iter()
            .find(|field| field.image_size() == image.size())
            .expect("fitted above");
        drop(render_to(field, image.size(), &Progress::none()));
    });
}
