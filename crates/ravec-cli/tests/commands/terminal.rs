//! Text from files and file names cannot drive the terminal that shows it.

use crate::pictures::bmp;
use crate::program::{code, done, folder, ravec, stderr, stdout};
use std::path::Path;

/// Sets the title of a window, clears the screen and reverses what follows.
const HOSTILE: &str = "\u{1b}]0;owned\u{7}\u{1b}[2J\u{9b}31m\u{202e}";

fn assert_harmless(text: &str) {
    let unsafe_char = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
    assert!(!text.contains(unsafe_char), "{text:?}");
}

/// Asserts that the text was shown, escaped.
#[track_caller]
fn assert_escaped(text: &str) {
    assert_harmless(text);
    assert!(
        // the parser of arguments leaves sequences that begin with ESC out
        [r"\u{1b}", r"\u001b", r"\x1b", r"\u{9b}"]
            .iter()
            .any(|escape| text.contains(escape)),
        "{text:?}"
    );
}

#[test]
fn names_of_files_are_escaped_in_summaries_logs_reports_warnings_and_errors() {
    let folder = folder();
    let name = format!("{HOSTILE}.bmp");
    let photo = bmp(32, 24, |col, row| [col as u8, row as u8, 9]);
    if std::fs::write(folder.path().join(&name), photo).is_err() {
        eprintln!("skipped: this file system refuses such names");
        return;
    }
    let output = ravec(folder.path(), &["compare", &name, "a.bmp", "-vv"]);
    assert_eq!(code(&output), 0);
    assert_escaped(&stdout(&output));
    assert_escaped(&stderr(&output));

    let output = ravec(folder.path(), &["compare", &name, "a.bmp", "--json", "-"]);
    assert_escaped(&stdout(&output));
    let report: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(
        report["inputs"][0]["path"],
        name.as_str(),
        "the data stay the same"
    );

    let missing = format!("no{name}");
    assert_escaped(&stderr(&ravec(
        folder.path(),
        &["compare", &missing, "a.bmp"],
    )));
    assert_escaped(&stderr(&ravec(
        folder.path(),
        &["compare", "a.bmp", "a.bmp", &name],
    )));
    assert_escaped(&stderr(&ravec(folder.path(), &[&name])));

    std::fs::write(folder.path().join(&missing), "no picture").unwrap();
    let output = ravec(
        folder.path(),
        &["library", "add", &missing, "--catalogue", "c"],
    );
    assert_escaped(&stderr(&output));
    let output = ravec(
        folder.path(),
        &["library", "add", &name, "--catalogue", "c"],
    );
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let output = ravec(folder.path(), &["library", "list", "--catalogue", "c"]);
    assert_escaped(&stdout(&output));
    let output = ravec(
        folder.path(),
        &[
            "demo",
            "--image",
            &name,
            "--max-side",
            "64",
            "--out",
            "gallery",
        ],
    );
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_harmless(&std::fs::read_to_string(folder.path().join("gallery/index.html")).unwrap());
}

#[test]
fn content_of_files_is_escaped_in_errors() {
    let folder = folder();
    let files: [(&str, String); 6] = [
        (
            "a.hdr",
            format!("#?RADIANCE\nFORMAT={HOSTILE}\n\n-Y 1 +X 1\n"),
        ),
        (
            "a.ply",
            format!("ply\nformat ascii 1.0\nelement {HOSTILE} 3\nend_header\n"),
        ),
        ("b.ply", format!("ply\nformat {HOSTILE} 1.0\nend_header\n")),
        (
            "a.obj",
            format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {HOSTILE}\n"),
        ),
        (
            "a.off",
            format!("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 {HOSTILE}\n3 0 1 2\n"),
        ),
        (
            "a.gltf",
            format!(r#"{{"asset":{{"version":"{HOSTILE}"}}}}"#),
        ),
    ];
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
        for arguments in [["mesh", "info", name], ["compare", name, name]] {
            let output = ravec(folder.path(), &arguments);
            assert_harmless(&stderr(&output));
            assert_harmless(&stdout(&output));
        }
    }
    let strokes = format!(r#"[{{"mode":"{HOSTILE}"}}]"#);
    std::fs::write(folder.path().join("strokes.json"), strokes).unwrap();
    let arguments = [
        "brush",
        "a.bmp",
        "-o",
        "out.png",
        "--stroke",
        "strokes.json",
    ];
    let output = ravec(folder.path(), &arguments);
    assert_eq!(code(&output), 3);
    assert_harmless(&stderr(&output));
    for expression in [format!("a | {HOSTILE}"), HOSTILE.to_owned()] {
        let output = ravec(
            folder.path(),
            &["boolean", &expression, "a.obj", "-o", "out.ply"],
        );
        assert_harmless(&stderr(&output));
    }
}

#[test]
fn a_gallery_runs_its_own_script_alone_and_fetches_nothing() {
    let folder = folder();
    done(
        folder.path(),
        "-q demo --image a.bmp --out gallery --max-side 64",
    );
    let page =
        std::fs::read_to_string(Path::new(folder.path()).join("gallery/index.html")).unwrap();
    assert!(page.contains("Content-Security-Policy\" content=\"default-src 'none'"));
    // the policy names the only script by its content; the others are data
    let (scripts, data) = ("<script>", "<script type=\"application/json\">");
    assert_eq!(page.matches(scripts).count(), 1);
    assert_eq!(
        page.matches("<script").count(),
        1 + page.matches(data).count()
    );
    assert!(page.contains("script-src 'sha256-") && !page.contains("unsafe-"));
}
