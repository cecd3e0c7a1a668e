//! Exports against what their programs expect.

use super::super::file::tests::track;
use super::*;
use glam::dvec2;

fn clip() -> Clip {
    Clip {
        rate: 30000.0 / 1001.0,
        first_number: 1,
        pixel_aspect: 1.0,
        centers: PixelCenters::Half,
    }
}

fn text(format: ExportFormat) -> String {
    let file = TrackFile {
        centers: PixelCenters::Half,
        planes: vec![track()],
    };
    let mut texts = texts(Path::new("out"), format, &file, &clip());
    assert_eq!(texts.len(), 1);
    texts.remove(0).1
}

#[test]
fn names_select_formats_and_formats_can_be_given() {
    for (text, format) in [
        ("a.json", ExportFormat::Json),
        ("a.aekf.txt", ExportFormat::AfterEffects),
        ("a.txt", ExportFormat::Text),
        ("A.NK", ExportFormat::Nuke),
        ("after-effects=a.txt", ExportFormat::AfterEffects),
        ("nuke=x=y", ExportFormat::Nuke),
        ("a=b.csv", ExportFormat::Csv),
        ("plane.py", ExportFormat::Blender),
    ] {
        let export: Export = text.parse().unwrap();
        assert_eq!(export.format(), Some(format), "{text}");
        assert_eq!(export.to_string(), text);
    }
    for text in ["", "a.doc", "nuke=", "flame=a.x"] {
        let error = text.parse::<Export>().unwrap_err();
        assert!(error.contains("FORMAT=FILE"), "{error}");
    }
}

#[test]
fn tables_have_a_line_for_each_frame() {
    let corners = text(ExportFormat::Text);
    assert_eq!(corners.lines().count(), 3);
    let numbers: Vec<f64> = corners
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    assert_eq!(numbers.len(), 24);
    assert_eq!(dvec2(numbers[2], numbers[3]), track().frames[0].corners[1]);
    let csv = text(ExportFormat::Csv);
    let lines: Vec<_> = csv.lines().collect();
    assert_eq!(lines.len(), 4);
    assert!(lines[3].starts_with("7,lost,"), "{csv}");
    assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
}

#[test]
fn nuke_counts_corners_from_the_lower_left_one_upward() {
    let script = text(ExportFormat::Nuke);
    let track = track();
    let line = |name: &str| {
        let line = script
            .lines()
            .find(|line| line.starts_with(&format!(" {name} ")));
        line.unwrap_or_else(|| panic!("no {name} in {script}"))
            .to_owned()
    };
    // frames 5 and 6 of pictures from 1 on are 6 and 7; frame 7 is lost
    let lower_left = track.frames[0].corners[3];
    let expected = format!(" to1 {{{{curve x6 {} x7 ", short(lower_left.x));
    assert!(line("to1").starts_with(&expected), "{}", line("to1"));
    assert!(line("to1").contains(&format!("{{curve x6 {} x7", short(480.0 - lower_left.y))));
    assert!(!script.contains("x8 "), "{script}");
    assert_eq!(line("from1"), " from1 {90 90}");
    assert_eq!(line("from3"), " from3 {500 390}");
    assert_eq!(line("from4"), " from4 {100.25 399.5}");
    assert_eq!(script.matches('{').count(), script.matches('}').count());
}

#[test]
fn after_effects_gets_four_blocks_in_its_order() {
    let data = text(ExportFormat::AfterEffects);
    let lines: Vec<_> = data.split("\r\n").collect();
    assert_eq!(lines[0], "Adobe After Effects 8.0 Keyframe Data");
    assert_eq!(lines[2], "\tUnits Per Second\t29.97");
    let block = |number: usize| {
        let head = format!("Effects\tADBE Corner Pin #1\tADBE Corner Pin-000{number}");
        let at = lines.iter().position(|line| **line == head).unwrap();
        assert_eq!(lines[at + 1], "\tFrame\tX pixels\tY pixels\t");
        let cells: Vec<f64> = lines[at + 2]
            .trim()
            .split('\t')
            .map(|cell| cell.parse().unwrap())
            .collect();
        assert_eq!(cells[0], 5.0);
        // two frames are found
        assert_eq!(lines[at + 4], "");
        dvec2(cells[1], cells[2])
    };
    for (number, corner) in [(1, 0), (2, 1), (3, 3), (4, 2)] {
        let expected = track().frames[0].corners[corner];
        assert!(block(number).distance(expected) < 1e-5);
    }
    assert!(data.ends_with("End of Keyframe Data\r\n"));
}

#[test]
fn blender_gets_shares_of_the_frame_and_muted_markers() {
    let script = text(ExportFormat::Blender);
    let corner = track().frames[0].corners[3];
    let line = script
        .lines()
        .find(|line| line.starts_with("    (6, True"))
        .unwrap();
    let numbers: Vec<f64> = line
        .split(['(', ')', ','])
        .filter_map(|word| word.trim().parse().ok())
        .collect();
    assert!((numbers[1] * 640.0 - corner.x).abs() < 1e-5, "{line}");
    assert!(
        (numbers[2] * 480.0 - (480.0 - corner.y)).abs() < 1e-5,
        "{line}"
    );
    assert!(script.contains("    (8, False, "));
}

#[test]
fn each_plane_has_a_file_of_its_number() {
    let file = TrackFile {
        centers: PixelCenters::Half,
        planes: vec![track(), track()],
    };
    let path = Path::new("p{plane}.csv");
    let texts = texts(path, ExportFormat::Csv, &file, &clip());
    let names: Vec<_> = texts
        .iter()
        .map(|(path, _)| path.to_str().unwrap())
        .collect();
    assert_eq!(names, ["p1.csv", "p2.csv"]);
    assert!(lacks_place(Path::new("p.csv"), ExportFormat::Csv));
    assert!(!lacks_place(Path::new("p.json"), ExportFormat::Json));
}
