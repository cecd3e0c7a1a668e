//! A page of pictures, captions and tables in one HTML file that needs nothing else.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ravec::raster::{Image, LinearRgba, Rect, Srgb, Srgba};
use ravec_jobs::escape_controls;
use ravec_media::{Format, Picture, WriteOptions, encode};
use std::fmt::Write as _;
use std::io::Cursor;

/// The page so far.
#[derive(Debug)]
pub struct Gallery {
    body: String,
}

/// A picture with its caption, encoded.
#[derive(Debug)]
pub struct Figure {
    source: String,
    caption: String,
    /// Width on the page in CSS pixels, if not that of the column; such pictures show their pixels.
    width: Option<usize>,
}

impl Figure {
    /// A whole picture. Opaque ones are stored as JPEG of high quality, others without loss.
    pub fn picture(image: &Image<LinearRgba>, caption: impl Into<String>) -> Self {
        let source = if image.is_opaque() {
            data_uri(
                &Picture::from_image(image.convert::<Srgb<u8>>()),
                Format::Jpeg,
            )
        } else {
            data_uri(
                &Picture::from_image(image.convert::<Srgba<u8>>()),
                Format::Png,
            )
        };
        Self {
            source,
            caption: caption.into(),
            width: None,
        }
    }

    /// A part of a picture with each pixel drawn as a square of `zoom` pixels, without loss. Parts beyond the picture are
    /// left out; nothing is drawn if there is nothing left.
    pub fn crop(
        image: &Image<LinearRgba>,
        part: Rect,
        zoom: usize,
        caption: impl Into<String>,
    ) -> Self {
        let part = part.intersection(Rect::of(image.size()));
        let cropped = part
            .size()
            .and_then(|size| image.crop(part.col, part.row, size).ok());
        let source = cropped.map_or(String::new(), |image| {
            data_uri(
                &Picture::from_image(image.convert::<Srgba<u8>>()),
                Format::Png,
            )
        });
        Self {
            source,
            caption: caption.into(),
            width: Some(part.width * zoom),
        }
    }

    /// A drawing as SVG, `width` CSS pixels wide.
    pub fn svg(text: &str, width: usize, caption: impl Into<String>) -> Self {
        Self {
            source: format!("data:image/svg+xml;base64,{}", STANDARD.encode(text)),
            caption: caption.into(),
            width: Some(width),
        }
    }
}

/// The picture as a data address.
fn data_uri(picture: &Picture, format: Format) -> String {
    let mut bytes = Cursor::new(Vec::new());
    let options = WriteOptions {
        quality: 90,
        ..WriteOptions::default()
    };
    // 8-bit pictures that are already in memory fit both formats; only a side beyond the format's limit can fail, and then
    // the caption stands alone
    if let Err(error) = encode(&mut bytes, format, picture, &options) {
        tracing::warn!("a figure was left out: {error}");
        return String::new();
    }
    let kind = if format == Format::Jpeg {
        "jpeg"
    } else {
        "png"
    };
    format!(
        "data:image/{kind};base64,{}",
        STANDARD.encode(bytes.into_inner())
    )
}

/// Text for HTML, with control characters made visible.
fn escaped(text: &str) -> String {
    escape_controls(text)
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

impl Gallery {
    /// A page with a heading and one paragraph.
    pub fn new(title: &str, lead: &str) -> Self {
        let title = escaped(title);
        let mut page = Self {
            body: format!(
                "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
                 <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
                 <meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n\
                 <style>{STYLE}</style>\n<main>\n<h1>{title}</h1>\n"
            ),
        };
        page.paragraph(lead);
        page
    }

    /// A new section.
    pub fn section(&mut self, heading: &str, text: &str) {
        self.push(format_args!("<h2>{}</h2>\n", escaped(heading)));
        self.paragraph(text);
    }

    /// A paragraph of plain text.
    pub fn paragraph(&mut self, text: &str) {
        self.push(format_args!("<p>{}</p>\n", escaped(text)));
    }

    /// Pictures side by side.
    pub fn figures(&mut self, figures: &[Figure]) {
        self.body.push_str("<div class=\"row\">\n");
        for figure in figures {
            let caption = escaped(&figure.caption);
            let attributes = match figure.width {
                Some(width) => format!(" class=\"pixels\" width=\"{width}\""),
                None => String::new(),
            };
            self.push(format_args!(
                "<figure><img{attributes} src=\"{}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>\n",
                figure.source
            ));
        }
        self.body.push_str("</div>\n");
    }

    /// A table with a heading row.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        self.body.push_str("<table>\n<tr>");
        for cell in head {
            self.push(format_args!("<th>{}</th>", escaped(cell)));
        }
        self.body.push_str("</tr>\n");
        for row in rows {
            self.body.push_str("<tr>");
            for cell in row {
                self.push(format_args!("<td>{}</td>", escaped(cell)));
            }
            self.body.push_str("</tr>\n");
        }
        self.body.push_str("</table>\n");
    }

    /// The finished page.
    pub fn finish(mut self) -> String {
        self.body.push_str("</main>\n</html>\n");
        self.body
    }

    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        self.body
            .write_fmt(text)
            .expect("a string takes every write");
    }
}

/// The page shows pictures that are inside it, and runs and fetches nothing.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// Follows the reader's choice of light or dark.
const STYLE: &str = "\
:root{color-scheme:light dark}\
body{margin:0;font:16px/1.5 system-ui,sans-serif}\
main{max-width:76rem;margin:auto;padding:2rem 1rem 4rem}\
h1{margin:0}h2{margin:3rem 0 .5rem}p{max-width:48rem}\
.row{display:flex;flex-wrap:wrap;gap:1rem;align-items:flex-start}\
figure{margin:0;flex:1 1 20rem;min-width:0;max-width:38rem}\
figure:has(.pixels){flex:0 0 auto}\
img{max-width:100%;height:auto;display:block;background:repeating-conic-gradient(#bbb 0 25%,#fff 0 50%) 0 0/16px 16px}\
.pixels{image-rendering:pixelated}\
figcaption{font-size:.85rem;opacity:.8;padding:.25rem 0;overflow-wrap:anywhere}\
table{border-collapse:collapse;margin:1rem 0}th,td{padding:.25rem .75rem;border-bottom:1px solid #8884;text-align:right}\
th:first-child,td:first-child{text-align:left}";

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::Size;

    #[test]
    fn a_page_holds_its_pictures_and_needs_nothing_else() {
        let image = Image::new(Size::new(6, 4).unwrap(), LinearRgba([0.5, 0.2, 0.1, 1.0]));
        let mut page = Gallery::new("A & B", "lead");
        page.section("First", "text with <angles> and \u{1b}[2J");
        page.figures(&[
            Figure::picture(&image, "whole"),
            Figure::crop(&image, Rect::new(4, 2, 10, 10), 4, "part \"quoted\""),
            Figure::svg("<svg/>", 30, "drawn"),
        ]);
        page.table(&["a", "b"], &[vec!["1".to_owned(), "2 < 3".to_owned()]]);
        let html = page.finish();
        assert!(html.contains("<title>A &amp; B</title>"));
        assert!(html.contains(r"text with &lt;angles&gt; and \u{1b}[2J"));
        assert!(html.contains("Content-Security-Policy"));
        assert!(html.contains("width=\"8\""));
        assert!(html.contains("2 &lt; 3"));
        assert_eq!(html.matches("data:image/").count(), 3);
        assert!(
            !html.contains("http:") && !html.contains("https:"),
            "nothing is fetched"
        );
    }

    #[test]
    fn transparent_pictures_keep_their_alpha_and_empty_crops_their_caption() {
        let image = Image::new(Size::new(2, 2).unwrap(), LinearRgba([0.5, 0.2, 0.1, 0.5]));
        assert!(
            Figure::picture(&image, "")
                .source
                .starts_with("data:image/png")
        );
        let outside = Figure::crop(&image, Rect::new(5, 5, 3, 3), 4, "nothing");
        assert_eq!(
            (outside.source.as_str(), outside.caption.as_str()),
            ("", "nothing")
        );
    }
}
