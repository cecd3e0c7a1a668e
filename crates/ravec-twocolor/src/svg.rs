//! Two-color images as vector graphics: SVG.
//!
//! Each block is a square in the color of its larger side, and over it a polygon in the color of the other. Equal-colored
//! neighbors become one outline, so that a flat sky is a single path:
//!
//! 1. Collect the faces of each color as directed edges on a grid of hundredths of a pixel.
//! 2. Where several faces meet along a block's border, cut their edges at each other's corners.
//! 3. Drop every edge whose opposite belongs to the same color: it lies inside.
//! 4. Chain what is left into closed outlines, and leave out corners on straight runs.
//!
//! Browsers blend each shape with what lies below along its rim, which shows hairlines between shapes that merely touch.
//! Here the polygons lie on their own squares, and all are drawn with a stroke of their color that is half a pixel of the
//! screen wide at any zoom, so that nothing shines through. Blocks with transparency are drawn as two polygons without
//! stroke; they may show hairlines.
//!
//! Cost: O(blocks log blocks); about 110 bytes a block of its own colors.

use crate::pixel::TwoColorPixel;
use crate::placed::{BlockField, PlacedBlock};
use glam::DVec2;
use ravec_raster::{Color, LinearRgba, Size, Srgb};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::{self, Write};

/// Parameters of a drawing.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SvgParams {
    /// Title of the drawing (default none).
    pub title: Option<String>,
    /// Levels of each color channel, 2 to 256 (default 256: colors as they are). Fewer merge more neighbors and make a
    /// smaller file of poster-like areas. Values outside the range are taken as the nearest end.
    pub color_levels: u16,
}

impl Default for SvgParams {
    fn default() -> Self {
        Self {
            title: None,
            color_levels: 256,
        }
    }
}

/// Units of the grid per pixel.
const GRID: i32 = 100;

/// The longest side of a drawing in pixels: corners are counted in hundredths of a pixel, in 32 bits.
pub const MAX_SVG_SIDE: usize = (i32::MAX / GRID) as usize;

/// A corner on the grid.
type Point = [i32; 2];

/// A color, and an alpha in 255ths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
struct Paint([u8; 3], u8);

/// The outline of what one color covers: directed edges, the covered side on the right as drawn.
#[derive(Debug, Default)]
struct Outline {
    edges: HashMap<Point, Vec<Point>>,
}

/// Writes the two-color image as an SVG drawing, one path a color. The view box is the fitted image in pixels.
///
/// # Errors
/// Those of the writer; [`io::ErrorKind::InvalidInput`] if a side exceeds [`MAX_SVG_SIDE`], before anything is written.
pub fn write_svg(
    blocks: &impl BlockField,
    params: &SvgParams,
    writer: &mut impl Write,
) -> io::Result<()> {
    let (width, height) = (blocks.image_size().width(), blocks.image_size().height());
    if width.max(height) > MAX_SVG_SIDE {
        let text = format!(
            "a drawing can have at most {MAX_SVG_SIDE} pixels on a side, the picture has {width} x {height}"
        );
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    writeln!(
        writer,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">"
    )?;
    if let Some(title) = &params.title {
        let title = title
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('>', "&gt;");
        let title: String = title.chars().filter(|c| !c.is_control()).collect();
        writeln!(writer, "<title>{title}</title>")?;
    }
    let drawing = Drawing::of(blocks, params.color_levels.clamp(2, 256));
    // the strokes of squares must not cover the polygons, so all squares come first
    writeln!(
        writer,
        "<style>path{{stroke-width:.5px;stroke-linejoin:round;vector-effect:non-scaling-stroke}}</style>"
    )?;
    for (paint, outline) in drawing.squares {
        let path = path(outline);
        let color = hex(paint);
        writeln!(
            writer,
            "<path fill=\"{color}\" stroke=\"{color}\" d=\"{path}\"/>"
        )?;
    }
    for (paint, outline) in drawing.polygons {
        let path = path(outline);
        let color = hex(paint);
        let rim = match paint.1 {
            255 => format!(" stroke=\"{color}\""),
            alpha => format!(" fill-opacity=\"{:.3}\"", f32::from(alpha) / 255.0),
        };
        writeln!(writer, "<path fill=\"{color}\"{rim} d=\"{path}\"/>")?;
    }
    writeln!(writer, "</svg>")
}

fn hex(Paint([r, g, b], _): Paint) -> String {
    let short = |v: u8| v >> 4 == v & 15;
    if short(r) && short(g) && short(b) {
        format!("#{:x}{:x}{:x}", r & 15, g & 15, b & 15)
    } else {
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}

/// The paint of one side.
fn paint_of(pixel: &TwoColorPixel, side: usize, levels: u16) -> Paint {
    let color = LinearRgba::from_rgb_alpha(pixel.colors[side].to_linear().rgb(), 1.0);
    let steps = f32::from(levels - 1);
    let rounded = Srgb::<f32>::from_linear(color)
        .0
        .map(|v| (v.clamp(0.0, 1.0) * steps).round() / steps);
    Paint(
        rounded.map(|v| (v * 255.0).round() as u8),
        (pixel.alphas[side] * 255.0).round() as u8,
    )
}

/// Outlines by color, squares below polygons.
#[derive(Debug, Default)]
struct Drawing {
    squares: BTreeMap<Paint, Outline>,
    polygons: BTreeMap<Paint, Outline>,
}

/// A convex face of one color.
struct Face {
    paint: Paint,
    is_square: bool,
    corners: Vec<Point>,
}

impl Drawing {
    fn of(blocks: &impl BlockField, levels: u16) -> Self {
        let limit = blocks.image_size();
        let faces: Vec<Face> = blocks
            .placed_blocks()
            .flat_map(|block| faces_of(&block, limit, levels))
            .collect();
        // the corners on each grid line, by which edges along it are cut
        let mut corners: [HashMap<i32, BTreeSet<i32>>; 2] = Default::default();
        for face in &faces {
            for &[x, y] in &face.corners {
                corners[0].entry(x).or_default().insert(y);
                corners[1].entry(y).or_default().insert(x);
            }
        }
        let mut drawing = Self::default();
        for face in &faces {
            let layer = if face.is_square {
                &mut drawing.squares
            } else {
                &mut drawing.polygons
            };
            let outline = layer.entry(face.paint).or_default();
            for (i, &from) in face.corners.iter().enumerate() {
                let to = face.corners[(i + 1) % face.corners.len()];
                outline.add_cut(from, to, &corners);
            }
        }
        drawing
    }
}

/// The faces of a block that are visible, clipped to the image.
fn faces_of(block: &PlacedBlock<'_>, limit: Size, levels: u16) -> Vec<Face> {
    let right = (block.col_px + block.side_px).min(limit.width());
    let bottom = (block.row_px + block.side_px).min(limit.height());
    let corner = |x: usize, y: usize| DVec2::new(x as f64, y as f64);
    let square = [
        corner(block.col_px, block.row_px),
        corner(right, block.row_px),
        corner(right, bottom),
        corner(block.col_px, bottom),
    ];
    let paints = [0, 1].map(|side| paint_of(block.pixel, side, levels));
    let line = block.line_in_image().filter(|_| paints[0] != paints[1]);
    let sides = match line {
        None => [square.to_vec(), Vec::new()],
        Some(line) => [
            half(&square, |p| -line.signed_distance(p)),
            half(&square, |p| line.signed_distance(p)),
        ],
    };
    let sides = sides.map(|side| snapped(&side));
    let [area_0, area_1] = [&sides[0], &sides[1]].map(|side| doubled_area(side));
    let under = usize::from(area_1 > area_0);
    let over = 1 - under;
    let mut faces = Vec::new();
    let opaque = paints.iter().all(|paint| paint.1 == 255);
    for side in [under, over] {
        let is_square = opaque && side == under;
        let corners = if is_square {
            snapped(&square)
        } else {
            sides[side].clone()
        };
        if doubled_area(&corners) > 0 && paints[side].1 > 0 {
            faces.push(Face {
                paint: paints[side],
                is_square,
                corners,
            });
        }
    }
    faces
}

/// The part of a convex polygon where `height` is positive.
fn half(polygon: &[DVec2], height: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut part = Vec::new();
    for (i, &from) in polygon.iter().enumerate() {
        let to = polygon[(i + 1) % polygon.len()];
        let (a, b) = (height(from), height(to));
        if a >= 0.0 {
            part.push(from);
        }
        if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
            part.push(from + (to - from) * (a / (a - b)));
        }
    }
    part
}

/// The corners on the grid, without repetitions.
fn snapped(polygon: &[DVec2]) -> Vec<Point> {
    let mut corners: Vec<Point> = polygon
        .iter()
        .map(|p| {
            [
                (p.x * f64::from(GRID)).round() as i32,
                (p.y * f64::from(GRID)).round() as i32,
            ]
        })
        .collect();
    corners.dedup();
    while corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    corners
}

/// Twice the area, positive for outlines that go round clockwise as drawn.
fn doubled_area(corners: &[Point]) -> i64 {
    (0..corners.len())
        .map(|i| {
            let ([x0, y0], [x1, y1]) = (corners[i], corners[(i + 1) % corners.len()]);
            i64::from(x0) * i64::from(y1) - i64::from(x1) * i64::from(y0)
        })
        .sum()
}

impl Outline {
    /// Adds an edge, cut at the corners that lie on it if it runs along the grid.
    fn add_cut(&mut self, from: Point, to: Point, corners: &[HashMap<i32, BTreeSet<i32>>; 2]) {
        let Some(axis) = [0, 1].into_iter().find(|&axis| from[axis] == to[axis]) else {
            self.add(from, to);
            return;
        };
        let other = 1 - axis;
        let (low, high) = (from[other].min(to[other]), from[other].max(to[other]));
        let at = |position: i32| {
            if axis == 0 {
                [from[0], position]
            } else {
                [position, from[1]]
            }
        };
        let between: Vec<i32> = corners[axis].get(&from[axis]).map_or(Vec::new(), |line| {
            line.range(low + 1..high).copied().collect()
        });
        let mut last = from;
        let mut cut = |position: i32| {
            let next = at(position);
            self.add(last, next);
            last = next;
        };
        if from[other] < to[other] {
            for &position in &between {
                cut(position);
            }
        } else {
            for &position in between.iter().rev() {
                cut(position);
            }
        }
        cut(to[other]);
    }

    /// Adds an edge, or drops it together with its opposite.
    fn add(&mut self, from: Point, to: Point) {
        if let Some(back) = self.edges.get_mut(&to)
            && let Some(i) = back.iter().position(|&end| end == from)
        {
            back.swap_remove(i);
            if back.is_empty() {
                self.edges.remove(&to);
            }
            return;
        }
        self.edges.entry(from).or_default().push(to);
    }

    /// The closed outlines, without the corners on straight runs; in the order of their first corners.
    fn loops(mut self) -> Vec<Vec<Point>> {
        let mut starts: Vec<Point> = self.edges.keys().copied().collect();
        starts.sort_unstable_by_key(|&[x, y]| (y, x));
        let mut loops = Vec::new();
        for start in starts {
            while self.edges.contains_key(&start) {
                let mut corners = vec![start];
                let mut at = start;
                // every corner has as many edges in as out, so the walk ends where it began
                while let Some(ends) = self.edges.get_mut(&at) {
                    let Some(next) = ends.pop() else { break };
                    if ends.is_empty() {
                        self.edges.remove(&at);
                    }
                    at = next;
                    if at == start {
                        break;
                    }
                    corners.push(at);
                }
                loops.push(without_straight_corners(&corners));
            }
        }
        loops
    }
}

fn without_straight_corners(corners: &[Point]) -> Vec<Point> {
    let n = corners.len();
    let turns = |i: usize| {
        let ([ax, ay], [bx, by], [cx, cy]) =
            (corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]);
        let cross =
            i64::from(bx - ax) * i64::from(cy - by) - i64::from(by - ay) * i64::from(cx - bx);
        let forward =
            i64::from(bx - ax) * i64::from(cx - bx) + i64::from(by - ay) * i64::from(cy - by);
        cross != 0 || forward < 0
    };
    (0..n).filter(|&i| turns(i)).map(|i| corners[i]).collect()
}

/// Path data in pixels, with relative coordinates.
fn path(outline: Outline) -> String {
    use std::fmt::Write as _;
    let mut text = String::new();
    for corners in outline.loops() {
        let Some(&first) = corners.first() else {
            continue;
        };
        let put = |text: &mut String, command: char, numbers: &[i32]| {
            text.push(command);
            for (i, &number) in numbers.iter().enumerate() {
                let number = decimal(number);
                if i > 0 && !number.starts_with('-') {
                    text.push(' ');
                }
                // a string takes every write
                let _ = write!(text, "{number}");
            }
        };
        put(&mut text, 'M', &first);
        let mut last = first;
        for &[x, y] in &corners[1..] {
            match (x - last[0], y - last[1]) {
                (dx, 0) => put(&mut text, 'h', &[dx]),
                (0, dy) => put(&mut text, 'v', &[dy]),
                (dx, dy) => put(&mut text, 'l', &[dx, dy]),
            }
            last = [x, y];
        }
        text.push('z');
    }
    text
}

/// Hundredths as a short decimal number.
fn decimal(hundredths: i32) -> String {
    let sign = if hundredths < 0 { "-" } else { "" };
    let value = hundredths.unsigned_abs();
    let (whole, part) = (value / 100, value % 100);
    let whole = if whole == 0 && part > 0 {
        String::new()
    } else {
        whole.to_string()
    };
    match part {
        0 => format!("{sign}{whole}"),
        _ if part.is_multiple_of(10) => format!("{sign}{whole}.{}", part / 10),
        _ => format!("{sign}{whole}.{part:02}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AdaptiveField, AdaptiveParams, FitParams, TwoColorField};
    use ravec_progress::Progress;
    use ravec_raster::{Image, Srgba};

    fn field(width: usize, height: usize) -> TwoColorField {
        let image = Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let edge = if (col * 3 + row * 2) % 70 < 33 {
                60
            } else {
                190
            };
            Srgb([edge as u8, (edge / 2 + row % 40) as u8, 80])
        });
        TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap()
    }

    fn drawn(blocks: &impl BlockField) -> String {
        let mut text = Vec::new();
        write_svg(blocks, &SvgParams::default(), &mut text).unwrap();
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn numbers_are_short_and_right() {
        for (value, text) in [
            (0, "0"),
            (800, "8"),
            (-50, "-.5"),
            (1234, "12.34"),
            (5, ".05"),
            (-310, "-3.1"),
        ] {
            assert_eq!(decimal(value), text);
        }
    }

    #[test]
    fn a_constant_image_is_a_single_square() {
        let image = Image::new(Size::new(37, 21).unwrap(), Srgb([255u8, 0, 0]));
        let field = TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap();
        let svg = drawn(&field);
        assert_eq!(svg.matches("<path").count(), 1);
        assert!(svg.contains("d=\"M0 0h37v21h-37z\""), "{svg}");
    }

    #[test]
    fn merged_outlines_cover_the_area_of_their_faces() {
        let regular = field(75, 50);
        let image = Image::from_fn(Size::new(75, 50).unwrap(), |col, row| {
            let v = if col * 2 > row * 3 { 40 } else { 200 };
            Srgb([v as u8, v as u8, (v + (col * row) % 50) as u8])
        });
        let adaptive =
            AdaptiveField::fit(&image, &AdaptiveParams::default(), &Progress::none()).unwrap();
        let check = |blocks: Vec<PlacedBlock<'_>>, drawing: Drawing| {
            let mut areas: BTreeMap<(bool, Paint), i64> = BTreeMap::new();
            for face in blocks
                .iter()
                .flat_map(|block| faces_of(block, Size::new(75, 50).unwrap(), 256))
            {
                *areas.entry((face.is_square, face.paint)).or_default() +=
                    doubled_area(&face.corners);
            }
            let layers = [(true, drawing.squares), (false, drawing.polygons)];
            for (is_square, layer) in layers {
                for (paint, outline) in layer {
                    let area: i64 = outline
                        .loops()
                        .iter()
                        .map(|corners| doubled_area(corners))
                        .sum();
                    assert_eq!(areas.remove(&(is_square, paint)), Some(area));
                }
            }
            assert!(areas.is_empty());
        };
        check(
            regular.placed_blocks().collect(),
            Drawing::of(&regular, 256),
        );
        check(
            adaptive.placed_blocks().collect(),
            Drawing::of(&adaptive, 256),
        );
    }

    #[test]
    fn squares_cover_an_opaque_image_wholly() {
        let field = field(41, 30);
        let area: i64 = Drawing::of(&field, 256)
            .squares
            .into_values()
            .flat_map(Outline::loops)
            .map(|corners| doubled_area(&corners))
            .sum();
        assert_eq!(area, 2 * 41 * 30 * i64::from(GRID) * i64::from(GRID));
    }

    #[test]
    fn invisible_sides_are_not_drawn_and_others_have_their_opacity() {
        let image = Image::from_fn(Size::new(16, 8).unwrap(), |col, _| {
            Srgba([200u8, 30, 30, if col < 5 { 128 } else { 0 }])
        });
        let field = TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap();
        let svg = drawn(&field);
        assert_eq!(svg.matches("<path").count(), 1, "{svg}");
        assert!(svg.contains("fill-opacity=\"0.502\""), "{svg}");
    }

    /// A picture without blocks.
    struct Empty(Size);

    impl BlockField for Empty {
        fn image_size(&self) -> Size {
            self.0
        }

        fn blocks_in_rows(
            &self,
            _: std::ops::Range<usize>,
        ) -> impl Iterator<Item = PlacedBlock<'_>> {
            std::iter::empty()
        }
    }

    #[test]
    fn sides_of_which_hundredths_do_not_fit_into_32_bits_are_refused() {
        for (width, height, fits) in [
            (MAX_SVG_SIDE, 1, true),
            (1, MAX_SVG_SIDE, true),
            (MAX_SVG_SIDE + 1, 1, false),
            (1, MAX_SVG_SIDE + 1, false),
        ] {
            let mut text = Vec::new();
            let field = Empty(Size::new(width, height).unwrap());
            let written = write_svg(&field, &SvgParams::default(), &mut text);
            assert_eq!((written.is_ok(), text.is_empty()), (fits, !fits));
        }
    }

    #[test]
    fn a_title_is_text_whatever_it_holds() {
        let mut text = Vec::new();
        let params = SvgParams {
            title: Some("a <b> & \u{1}c".to_owned()),
            ..SvgParams::default()
        };
        write_svg(&field(8, 8), &params, &mut text).unwrap();
        assert!(
            String::from_utf8(text)
                .unwrap()
                .contains("<title>a &lt;b&gt; &amp; c</title>")
        );
    }
}
