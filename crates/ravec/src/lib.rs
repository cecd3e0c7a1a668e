//! Raster and vector views of images that work together: all libraries of Ravec under one name.
//!
//! Pixels are robust and easy to search; lines and polygons are exact and easy to edit. Ravec holds both views of the same
//! data and moves between them.
//!
//! | module | what is in it |
//! | --- | --- |
//! | [`raster`] | images with typed colors, sampling, filters, metrics |
//! | [`twocolor`] | two-color pixels, and filters that do not cross edges |
//! | [`planar`] | homographies, matching of photos, grids in perspective, rectification |
//! | [`completion`] | holes filled from the rest of a picture, in perspective where planes are known |
//! | [`matting`] | alpha and foreground colors of pictures and clips |
//! | [`video_edit`] | shots edited like one picture: background plates, removal, replacement, enhancement, paste |
//! | [`retarget`] | one picture in many formats, with objects in shape and lines straight |
//! | [`mesh`] | triangle meshes: measures, checks, distances, simplification |
//! | [`mesh_io`] | files of meshes: STL, PLY, OBJ, OFF, 3MF, glTF |
//! | [`mesh_render`] | pictures of meshes |
//! | [`offset`](mod@offset) | surfaces at a distance from any triangles, within a tolerance that is proved |
//! | [`boolean`](mod@boolean) | expressions over any triangle meshes, exact where they meet |
//! | [`progress`] | progress and cancellation of long work |
//!
//! Everything here but [`mesh_io`] works in memory. Picture files are read and written by the crate `ravec-media`, which is
//! not part of this one, so that a program which has its pixels already does not compile their codecs.
//!
//! With the feature `serde`, all parameters and reports are data; with `clap`, choices such as [`offset::Side`] are values of
//! flags.
//!
//! # Images say what their pixels mean
//!
//! The pixel type carries color space, sample kind and alpha, so that a wrong mixture does not compile. Averaging belongs
//! in linear light, and the difference is not small: the mean of black and white is a much lighter gray than the mean of
//! their encoded values.
//!
//! ```
//! use ravec::raster::{Color, Image, LinearRgb, Size, Srgb};
//!
//! let stripes = Image::from_fn(Size::new(64, 64)?, |col, _| Srgb([255 * (col % 2) as u8; 3]));
//! let linear = stripes.convert::<LinearRgb>();
//! let mean = linear.pixels().iter().map(|pixel| pixel.0[0]).sum::<f32>() / 4096.0;
//! let gray = Srgb::<u8>::from_linear(LinearRgb([mean; 3]).to_linear());
//! assert_eq!(gray, Srgb([188; 3]));
//! # Ok::<(), ravec::raster::SizeError>(())
//! ```
//!
//! # Blocks become lines
//!
//! A two-color pixel is a block of pixels that is replaced by one line and a color on each side of it. Of all the ways in
//! which a line can split the block, the fit takes the best, and then finds the line itself to a fraction of a pixel.
//!
//! ```
//! use ravec::progress::Progress;
//! use ravec::raster::Size;
//! use ravec::twocolor::{FitParams, TwoColorField};
//! use ravec_scenes::edge::{EdgeTruth, TwoColors, edge};
//!
//! // an edge whose normal points 30 degrees below the x axis, 2 pixels to the right of the middle of a 64 × 64 picture
//! let colors = TwoColors::from_encoded([200.0, 60.0, 40.0], [40.0, 70.0, 120.0]);
//! let truth = EdgeTruth::from_angle(30f64.to_radians(), (34.0, 32.0).into(), colors);
//! let picture = edge(Size::new(64, 64)?, &truth);
//!
//! let progress = Progress::none();
//! let mut field = TwoColorField::fit(&picture, &FitParams::default(), &progress)?;
//! field.refine_lines(&picture, &progress)?;
//!
//! assert!(field.block(0, 0).is_flat());
//! let line = field.block(4, 4).line.expect("the edge crosses this block");
//! assert!((line.normal.dot(truth.normal).abs() - 1.0).abs() < 1e-4, "parallel to the edge");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # From edges to planes
//!
//! Lines of neighboring blocks join to straight segments. Where segments of two directions cross there may be a plane, and two
//! planes at right angles give the focal length.
//!
//! ```
//! use ravec::planar::propose_planes;
//! use ravec::progress::Progress;
//! use ravec::raster::{Size, Srgb};
//! use ravec::twocolor::line_segments;
//! use ravec_scenes::{Seed, building::building};
//!
//! let (picture, truth) = building(Size::new(960, 720)?, 0.9, Seed(3));
//! let edges = line_segments(&picture.convert::<Srgb<u8>>(), &Progress::none())?;
//! let found = propose_planes(&edges, (960.0, 720.0).into(), None, &Progress::none())?;
//! assert!(found.planes.len() >= 2, "both walls");
//! let focal_px = found.focal_px.expect("the walls are at right angles");
//! assert!((focal_px / truth.focal_px - 1.0).abs() < 0.05);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Noise goes, edges stay
//!
//! Every window of a picture knows on which side of its line a pixel lies, so that averages need not cross edges.
//!
//! ```
//! use ravec::progress::Progress;
//! use ravec::raster::{Image, Rect, Size, Srgb};
//! use ravec::twocolor::{CleanParams, clean};
//! use ravec_scenes::{Seed, damage::add_gaussian_noise};
//!
//! let steps = Image::from_fn(Size::new(96, 64)?, |col, _| Srgb([if col < 48 { 90u8 } else { 160 }; 3]));
//! let noisy = add_gaussian_noise(&steps, 15.0, Seed(1));
//!
//! let params = CleanParams { noise_sigma: Some(15.0), ..CleanParams::default() };
//! let cleaned = clean(&noisy, Rect::of(noisy.size()), &params, &Progress::none())?.convert::<Srgb<u8>>();
//!
//! let error = |image: &Image<Srgb<u8>>| {
//!     let pairs = image.pixels().iter().zip(steps.pixels());
//!     pairs.map(|(a, b)| f64::from(a.0[1].abs_diff(b.0[1]))).sum::<f64>()
//! };
//! assert!(error(&cleaned) < 0.2 * error(&noisy));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # One picture, many formats
//!
//! A grid over the picture is deformed so that what matters keeps its shape and straight lines stay straight. The picture is
//! analyzed once; each further size takes milliseconds, and no cell of the grid ever folds.
//!
//! ```
//! use ravec::progress::Progress;
//! use ravec::raster::{Size, Srgb};
//! use ravec::retarget::{Painted, RetargetParams, Retargeter};
//! use ravec_scenes::{Seed, portraits::portraits};
//!
//! let photo = portraits(Size::new(180, 120)?, Seed(1)).0.convert::<Srgb<u8>>();
//! let params = RetargetParams { grid_cells: Some(40), ..RetargetParams::default() };
//! let retargeter = Retargeter::new(&photo, Painted::default(), &params, &Progress::none())?;
//! for size in [Size::new(120, 120)?, Size::new(90, 160)?] {
//!     let deformation = retargeter.solve(size)?;
//!     assert!(deformation.summary().least_area > 0.0);
//!     assert_eq!(deformation.warp(&photo, &Progress::none())?.size(), size);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Surfaces at a distance
//!
//! The offset of a mesh is what lies at a given distance from its triangles. The mesh may be any triangles at all; the
//! result is closed, does not meet itself, and says whether each of its facets is proved to keep the distance.
//!
//! ```
//! use ravec::offset::{OffsetParams, Side, offset};
//! use ravec::progress::Progress;
//! use ravec_scenes::solids::crossing_plates;
//!
//! // two squares that go through each other: not the surface of any solid
//! let plates = crossing_plates(2.0).mesh;
//! let params = OffsetParams { distance: 0.2, tolerance: 0.01, side: Side::Outer, ..OffsetParams::default() };
//! let padded = offset(&plates, &params, &Progress::none())?;
//! assert!(padded.report.certified && padded.report.solid);
//! # Ok::<(), ravec::offset::OffsetError>(())
//! ```
//!
//! # Meshes combined by expressions
//!
//! Each mesh stands for the places that it winds around, be it closed or not. An expression says what is wanted of them; its
//! surface is exact where meshes meet, and made of their own triangles everywhere else.
//!
//! ```
//! use ravec::boolean::{BooleanParams, Expr, boolean};
//! use ravec::progress::Progress;
//! use ravec_scenes::solids::{cuboid, cylinder};
//!
//! let plate = cuboid([4.0, 4.0, 1.0].into()).mesh;
//! let pin = cylinder(1.0, 3.0, 32).mesh;
//! let (expr, names) = Expr::parse("plate - pin")?;
//! assert_eq!(names, ["plate", "pin"]);
//! let drilled = boolean(&[plate, pin], &expr, &BooleanParams::default(), &Progress::none())?;
//! assert!(drilled.report.solid);
//! assert!((drilled.report.volume - (16.0 - std::f64::consts::PI)).abs() < 0.05);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Meshes are judged before they are used
//!
//! A mesh is a list of triangles that promises nothing. What it is the surface of is found by exact arithmetic, and how far
//! two surfaces are apart is enclosed by bounds that hold for all of their points.
//!
//! ```
//! use ravec::mesh::{
//!     CheckParams, HausdorffParams, Keep, SimplifyParams, check, hausdorff, simplify,
//! };
//! use ravec::progress::Progress;
//! use ravec_scenes::solids::torus;
//!
//! let progress = Progress::none();
//! let torus = torus(2.0, 0.7, 60, 30).mesh;
//! let found = check(&torus, &CheckParams::default(), &progress)?;
//! assert!(found.is_solid() && found.genus == Some(1));
//!
//! let params = SimplifyParams { target_triangles: 1000, ..SimplifyParams::default() };
//! let simple = simplify(&torus, &params, &Keep::default(), |_| false, &progress)?.mesh;
//! let apart = hausdorff(&torus, &simple, &HausdorffParams::default(), &progress)?;
//! assert!(apart.upper() < 0.1, "for all points of both");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Long work can be watched and stopped
//!
//! Whatever may take longer than a moment takes a [`progress::Progress`]. It is the caller who decides what becomes of it.
//!
//! ```
//! use ravec::progress::{Cancelled, Progress};
//!
//! let progress = Progress::new(|update| eprintln!("{}: {:.0} %", update.phase, 100.0 * update.fraction()));
//! let phase = progress.phase("rows", 2);
//! phase.advance(1);
//! progress.cancel();
//! assert_eq!(progress.check(), Err(Cancelled));
//! ```
//!
//! # Conventions
//!
//! - y points down; the center of pixel `(col, row)` is at `(col + 0.5, row + 0.5)`.
//! - `(col, row)` are integers, `(x, y)` are reals; sizes are width × height.
//! - Meshes are right-handed; triangles run counter-clockwise as seen from outside.
//! - Samples are `f32`, geometry is `f64`, vectors are those of `glam`.
//! - Colors are in linear light with sRGB primaries unless their type says otherwise.
//! - Straight and premultiplied alpha are different types; only premultiplied pixels are averaged.
//! - Same input, parameters and seed give the same bytes, on any number of threads.

pub use ravec_boolean as boolean;
pub use ravec_completion as completion;
#[cfg(feature = "gpu")]
pub use ravec_gpu as gpu;
pub use ravec_matting as matting;
pub use ravec_memory as memory;
pub use ravec_mesh as mesh;
pub use ravec_mesh_io as mesh_io;
pub use ravec_mesh_render as mesh_render;
pub use ravec_mosaic as mosaic;
pub use ravec_offset as offset;
pub use ravec_pieces as pieces;
pub use ravec_planar as planar;
pub use ravec_progress as progress;
pub use ravec_raster as raster;
pub use ravec_retarget as retarget;
pub use ravec_twocolor as twocolor;
pub use ravec_video_edit as video_edit;

/// Runs the examples of the readme.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
