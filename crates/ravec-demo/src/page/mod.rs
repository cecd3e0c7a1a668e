//! A page of pictures, solids, captions and tables in one HTML file that needs nothing else.

mod figure;
mod solid;

pub use figure::Figure;
pub use solid::{MAX_TRIANGLES, Solid};

use ravec_jobs::escape_controls;
use std::fmt::Write as _;

/// The page around the sections, with places for its parts in braces.
const PAGE: &str = include_str!("page.html");

/// Follows the reader's choice of light or dark.
const STYLE: &str = include_str!("page.css");

/// The contents that follow the reader, dividers of pictures, and the viewer of solids.
const SCRIPT: &str = include_str!("page.js");

/// Longer cells of a table are broken into lines, in bytes.
const MAX_LINE: usize = 40;

/// The page so far.
#[derive(Debug)]
pub struct Gallery {
    title: String,
    lead: String,
    contents: String,
    body: String,
    /// The names by which the contents find sections.
    names: Vec<String>,
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
    /// Begins a page with a heading and one paragraph.
    pub fn new(title: &str, lead: &str) -> Self {
        Self {
            title: escaped(title),
            lead: escaped(lead),
            contents: String::new(),
            body: String::new(),
            names: Vec::new(),
        }
    }

    /// Begins a group of sections in the contents. The page shows no heading for it.
    pub fn chapter(&mut self, heading: &str) {
        if !self.contents.is_empty() {
            self.contents.push_str("</ul>\n");
        }
        let heading = escaped(heading);
        write!(self.contents, "<p>{heading}</p>\n<ul>\n").expect(ENDLESS);
    }

    /// Begins a section, which the contents name.
    pub fn section(&mut self, heading: &str, text: &str) {
        if self.contents.is_empty() {
            self.contents.push_str("<ul>\n");
        }
        if !self.names.is_empty() {
            self.body.push_str("</section>\n");
        }
        let name = self.name(heading);
        let heading = escaped(heading);
        writeln!(self.contents, "<li><a href=\"#{name}\">{heading}</a></li>").expect(ENDLESS);
        self.push(format_args!(
            "<section id=\"{name}\">\n<h2>{heading}</h2>\n"
        ));
        self.names.push(name);
        self.paragraph(text);
    }

    /// A name for a section that no other has: letters and digits of its heading, and a number if it is taken.
    fn name(&self, heading: &str) -> String {
        let letters = heading.to_lowercase();
        let words = letters.split(|c: char| !c.is_ascii_alphanumeric());
        let words: Vec<_> = words.filter(|word| !word.is_empty()).collect();
        // not one of the names of the page itself
        let plain = format!("s-{}", words.join("-"));
        let numbered = (2..).map(|number| format!("{plain}-{number}"));
        let mut names = std::iter::once(plain.clone()).chain(numbered);
        let free = names.find(|name| !self.names.contains(name));
        free.expect("there are more numbers than sections")
    }

    /// Adds a paragraph of plain text.
    pub fn paragraph(&mut self, text: &str) {
        self.push(format_args!("<p>{}</p>\n", escaped(text)));
    }

    /// Adds figures side by side: four pictures in one row of four, others as many in a row as fit.
    pub fn figures(&mut self, figures: &[Figure]) {
        let alike = !figures.iter().any(Figure::is_sized);
        let turned = figures.iter().any(Figure::is_solid);
        let class = match figures.len() {
            4 if alike && !turned => "row four",
            3.. if alike => "row even",
            _ => "row",
        };
        self.push(format_args!("<div class=\"{class}\">\n"));
        for figure in figures {
            self.body.push_str(&figure.html());
        }
        self.body.push_str("</div>\n");
    }

    /// Adds a table with a heading row.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        self.body.push_str("<div class=\"table\"><table>\n<tr>");
        for cell in head {
            self.push(format_args!("<th scope=\"col\">{}</th>", escaped(cell)));
        }
        self.body.push_str("</tr>\n");
        for row in rows {
            self.body.push_str("<tr>");
            for cell in row {
                let class = if cell.len() > MAX_LINE {
                    " class=\"long\""
                } else {
                    ""
                };
                self.push(format_args!("<td{class}>{}</td>", escaped(cell)));
            }
            self.body.push_str("</tr>\n");
        }
        self.body.push_str("</table></div>\n");
    }

    /// The finished page.
    pub fn finish(mut self) -> String {
        if !self.contents.is_empty() {
            self.contents.push_str("</ul>\n");
        }
        if !self.names.is_empty() {
            self.body.push_str("</section>\n");
        }
        let parts = [
            ("{TITLE}", &self.title[..]),
            ("{STYLE}", STYLE),
            ("{TITLE}", &self.title),
            ("{CONTENTS}", &self.contents),
            ("{TITLE}", &self.title),
            ("{LEAD}", &self.lead),
            ("{BODY}", &self.body),
            ("{SCRIPT}", SCRIPT),
        ];
        let mut page = String::with_capacity(self.body.len() + 64 * 1024);
        let mut rest = PAGE;
        for (place, part) in parts {
            let (before, after) = rest
                .split_once(place)
                .expect("the page has the places in this order");
            page.push_str(before);
            page.push_str(part);
            rest = after;
        }
        page.push_str(rest);
        page
    }

    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        self.body.write_fmt(text).expect(ENDLESS);
    }
}

/// Why text can be appended.
const ENDLESS: &str = "a string takes every write";

#[cfg(test)]
pub mod tests {
    use super::*;
    use base64::Engine as _;
    use ravec::raster::{Image, LinearRgba, Rect, Size};
    use sha2::{Digest as _, Sha256};
    use std::collections::HashSet;

    /// The texts between each `begin` and the next `end`.
    fn all_between<'a>(text: &'a str, begin: &str, end: &str) -> Vec<&'a str> {
        let parts = text.split(begin).skip(1);
        parts.map(|part| part.split_once(end).unwrap().0).collect()
    }

    /// Asserts that elements are closed in the order in which they were opened, that names are there once, and that nothing
    /// is fetched.
    pub fn assert_well_formed(page: &str) {
        assert!(page.starts_with("<!doctype html>") && page.trim_end().ends_with("</html>"));
        let lower = page.to_lowercase();
        assert!(!lower.contains("http:") && !lower.contains("https:") && !lower.contains("url("));
        // names and anchors
        let markup = page.split("<script>").next().unwrap();
        let names = all_between(markup, " id=\"", "\"");
        let distinct: HashSet<_> = names.iter().collect();
        assert_eq!(names.len(), distinct.len());
        for anchor in all_between(markup, " href=\"", "\"") {
            let name = anchor.strip_prefix('#').unwrap();
            assert!(names.contains(&name), "{anchor}");
        }
        // elements
        let mut open = Vec::new();
        let mut rest = &markup[markup.find("<html").unwrap()..];
        while let Some(at) = rest.find('<') {
            let (tag, after) = rest[at + 1..].split_once('>').unwrap();
            rest = after;
            let name = tag.split([' ', '\n']).next().unwrap();
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name), "<{tag}>"),
                None if ["img", "meta"].contains(&name) => {}
                None => open.push(name),
            }
            if ["script", "style"].contains(&name) {
                rest = &rest[rest.find("</").unwrap()..];
            }
        }
        assert_eq!(open, ["html", "body"]);
        // dividers only where both pictures have the same size
        for pair in all_between(markup, "<figure class=\"compare", "</figure>") {
            let sizes = |name: &str| all_between(pair, name, "\"");
            for name in [" width=\"", " height=\""] {
                let [a, b] = sizes(name)[..] else {
                    panic!("a pair has two pictures");
                };
                assert_eq!(a, b);
            }
        }
        // solids hold what they state
        for data in all_between(markup, "<script type=\"application/json\">", "</script>") {
            let data: serde_json::Value = serde_json::from_str(data).unwrap();
            for (name, of) in [("positions", "vertices"), ("corners", "triangles")] {
                let bytes =
                    base64::engine::general_purpose::STANDARD.decode(data[name].as_str().unwrap());
                let count = data[of].as_u64().unwrap() as usize;
                assert_eq!(bytes.unwrap().len(), 6 * count, "{name}");
            }
            assert!(data["triangles"].as_u64().unwrap() <= MAX_TRIANGLES as u64);
        }
    }

    #[test]
    fn a_page_holds_its_pictures_and_needs_nothing_else() {
        let image = Image::new(Size::new(6, 4).unwrap(), LinearRgba([0.5, 0.2, 0.1, 1.0]));
        let mut page = Gallery::new("A & B", "lead");
        page.chapter("Some <of> them");
        page.section("First", "text with <angles> and \u{1b}[2J");
        page.figures(&[
            Figure::picture(&image, "whole"),
            Figure::crop(&image, Rect::new(4, 2, 10, 10), 4, "part \"quoted\""),
            Figure::svg("<svg/>", [30, 20], "drawn"),
        ]);
        page.section("First", "{BODY} and {SCRIPT} are plain text");
        page.table(&["a", "b"], &[vec!["1".to_owned(), "2 < 3".to_owned()]]);
        let html = page.finish();
        assert_well_formed(&html);
        assert!(html.contains("<title>A &amp; B</title>"));
        assert!(html.contains(r"text with &lt;angles&gt; and \u{1b}[2J"));
        assert!(html.contains("<p>{BODY} and {SCRIPT} are plain text</p>"));
        assert!(html.contains("href=\"#s-first\"") && html.contains("id=\"s-first-2\""));
        assert!(html.contains("width=\"8\" height=\"8\""));
        assert!(html.contains("2 &lt; 3"));
        assert_eq!(html.matches("data:image/").count(), 3);
    }

    #[test]
    fn the_policy_lets_only_the_own_script_and_style_run() {
        let hash =
            |text: &str| base64::engine::general_purpose::STANDARD.encode(Sha256::digest(text));
        let page = Gallery::new("a", "b").finish();
        let policy = all_between(&page, "\"Content-Security-Policy\" content=\"", "\">");
        assert_eq!(
            policy,
            [format!(
                "default-src 'none'; img-src data:; script-src 'sha256-{}'; style-src 'sha256-{}'; base-uri 'none'; form-action 'none'",
                hash(SCRIPT),
                hash(STYLE)
            )]
        );
        // what the policy would refuse is not there
        assert!(!page.contains(" style=") && !page.contains(" onload="));
        assert!(!page.contains(" onclick=") && !page.contains("eval("));
        // nothing that is shown is taken for text of a page
        assert!(!page.contains("innerHTML") && !page.contains("document.write"));
    }
}
