//! The deformed grid as a drawing: SVG.

use crate::deformation::Deformation;
use std::io::{self, Write};

impl Deformation {
    /// Writes the deformed grid as SVG, in pixels of the new picture: cells tinted by their weight, blue where the picture gives
    /// way to red where it keeps its shape, green where it is protected; straight runs as thick lines.
    ///
    /// `backdrop` is the address of a picture to be drawn below, such as a file beside the drawing or a `data:` address.
    ///
    /// # Errors
    /// Any error of the writer.
    pub fn write_grid_svg(&self, backdrop: Option<&str>, out: &mut impl Write) -> io::Result<()> {
        let (width, height) = (self.size().width(), self.size().height());
        writeln!(
            out,
            r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">"#
        )?;
        if let Some(address) = backdrop {
            let address = escaped(address);
            writeln!(
                out,
                r#"<image href="{address}" width="{width}" height="{height}"/>"#
            )?;
        }
        // lines that are seen at the size of the picture
        let line = (width.max(height) as f64 / 1000.0).max(0.5);
        writeln!(
            out,
            r##"<g stroke="#fff" stroke-opacity="0.7" stroke-width="{line:.2}" fill-opacity="0.35">"##
        )?;
        for (corners, weight) in self.cells() {
            write!(out, r#"<path fill="{}" d=""#, tint(weight))?;
            for (index, corner) in corners.iter().enumerate() {
                let command = if index == 0 { 'M' } else { 'L' };
                write!(out, "{command}{:.2} {:.2}", corner.x, corner.y)?;
            }
            writeln!(out, r#"Z"/>"#)?;
        }
        writeln!(out, "</g>")?;
        writeln!(
            out,
            r##"<g fill="none" stroke="#ffd400" stroke-width="{:.2}">"##,
            3.0 * line
        )?;
        for run in self.straight_runs() {
            write!(out, r#"<polyline points=""#)?;
            for point in run {
                write!(out, "{:.2},{:.2} ", point.x, point.y)?;
            }
            writeln!(out, r#""/>"#)?;
        }
        writeln!(out, "</g>\n</svg>")
    }
}

fn tint(weight: f64) -> String {
    if weight > 1.0 {
        return "#00c040".to_owned();
    }
    // the eye sees little of the first tenths otherwise
    let share = weight.max(0.0).sqrt();
    let channel = |from: f64, to: f64| (from + share * (to - from)) as u8;
    format!(
        "#{:02x}{:02x}{:02x}",
        channel(30.0, 240.0),
        channel(90.0, 40.0),
        channel(220.0, 40.0)
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use crate::{Painted, RetargetParams, Retargeter};
    use ravec_progress::Progress;
    use ravec_raster::{Image, LinearRgb, Size};

    #[test]
    fn the_drawing_has_a_shape_for_each_cell_and_run() {
        let image = Image::from_fn(Size::new(160, 120).unwrap(), |col, row| {
            LinearRgb([if row > 40 + col / 4 { 0.6 } else { 0.1 }; 3])
        });
        let params = RetargetParams {
            grid_cells: Some(16),
            ..RetargetParams::default()
        };
        let none = Progress::none();
        let found = Retargeter::new(&image, Painted::default(), &params, &none).unwrap();
        let deformation = found.solve(Size::new(100, 120).unwrap()).unwrap();
        let mut svg = Vec::new();
        deformation
            .write_grid_svg(Some("a \"b\" & c.png"), &mut svg)
            .unwrap();
        let text = String::from_utf8(svg).unwrap();
        assert_eq!(text.matches("<path").count(), 16 * 12);
        assert_eq!(
            text.matches("<polyline").count(),
            found.summary().straight_runs
        );
        assert!(text.contains("href=\"a &quot;b&quot; &amp; c.png\""));
        assert!(text.ends_with("</svg>\n"));
    }
}
