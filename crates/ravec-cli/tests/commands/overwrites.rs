//! No output of any operation takes the place of a file that the run reads, however its path is spelled.

use crate::meshes::parts;
use crate::program::{assert_refused, done, folder, ravec};
use clap::Command;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// An operation: its arguments, where those that begin with `<` are files that are read and those that begin with `>` are
/// files that are written. The report of `--json` is an output of all of them, the recipe of `--recipe` of all steps.
const OPERATIONS: &[&str] = &[
    "compare <a.bmp <b.bmp",
    "match <a.bmp <b.bmp -o >out.txt",
    "rectify <a.bmp --quad 0,0,9,0,9,9,0,9 -o >out.png",
    "snap <a.bmp --quad 0,0,9,0,9,9,0,9 -o >out.png",
    "planes <a.bmp -o >out.png",
    "track <clip.y4m --quad 0,0,9,0,9,9,0,9 --show >out.y4m",
    "track clip.y4m --track <steps.json -o >out.json --export >more.json",
    "stabilize <clip.y4m -o >out.y4m",
    "plate <clip.y4m --exclude <a.bmp --strokes <c.bmp --seen >seen.png --certainty >certainty.png -o >out.png",
    "matte <a.bmp --plate <b.bmp --trimap <d.bmp --strokes <c.bmp -o >out.png",
    "complete <a.bmp --mask <b.bmp --features <c.bmp --source <d.bmp --replay <steps.json --steps >s.json -o >out.png",
    "retarget <a.bmp --protect <b.bmp --give-way <c.bmp --size 50% --show-grid >grid.svg -o >out.png",
    "twocolor <a.bmp -o >out.png --svg >out.svg",
    "brush <a.bmp --mode mask --stroke <points.json --mask >mask.png -o >out.png",
    "mesh info <part.stl",
    "mesh check <part.stl",
    "mesh convert <part.stl -o >out.ply",
    "mesh compare <part.stl <other.ply",
    "mesh render <part.stl --compare <other.ply -o >out.png",
    "mesh simplify <part.stl --triangles 9 -o >out.ply",
    "offset <part.stl --distance 2% -o >out.ply",
    "boolean union <part.stl <other.ply --origins >o.csv --picture >out.png -o >out.ply",
    "library add <photos <d.bmp --catalogue <photos.ravec",
    "library remove photos --catalogue <photos.ravec",
    "library list --catalogue <photos.ravec",
    "library clean --catalogue <photos.ravec",
    "library stats --catalogue <photos.ravec",
    "mosaic <a.bmp --catalogue <photos.ravec -o >out.png",
    "video info <clip.y4m",
    "video convert <clip.y4m >out.y4m",
    "video remove <clip.y4m --plate <a.bmp --matte <b.bmp --track <steps.json -o >out.y4m",
    "video replace <clip.y4m --plate <a.bmp --matte <b.bmp --image <c.bmp -o >out.y4m",
    "video enhance <clip.y4m --plate <a.bmp --matte <b.bmp --photo <c.bmp -o >out.y4m",
    "video overlay <clip.y4m --image <a.bmp --matte <b.bmp -o >out.y4m",
    "video paste <clip.y4m --plate <a.bmp --matte <b.bmp --into <c.bmp --into-matte <d.bmp -o >out.y4m",
    "video frames <photos --at 0 -o >out.png",
    "demo --image <a.bmp --out gallery",
    "run <recipe.json",
];

/// Operations that read no file.
const WITHOUT_INPUTS: &[&str] = &["scenes", "studio", "completions", "man", "help"];

fn studio() -> tempfile::TempDir {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    parts(folder.path());
    for name in ["c.bmp", "d.bmp"] {
        std::fs::copy(at("a.bmp"), at(name)).unwrap();
    }
    std::fs::write(at("clip.y4m"), "YUV4MPEG2 W2 H1 Cmono\nFRAME\nab").unwrap();
    std::fs::write(at("points.json"), "[[5, 5], [15, 10]]").unwrap();
    std::fs::write(at("steps.json"), "{}").unwrap();
    let recipe =
        r#"{"version": 1, "steps": [{"operation": "compare", "a": "a.bmp", "b": "b.bmp"}]}"#;
    std::fs::write(at("recipe.json"), recipe).unwrap();
    std::fs::create_dir(at("photos")).unwrap();
    done(
        folder.path(),
        "-q scenes --out photos --scene disc --scene street --width 80 --height 60",
    );
    done(
        folder.path(),
        "-q library add photos --catalogue photos.ravec",
    );
    folder
}

/// Every file below a folder with its content.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && !path.is_symlink() {
            all.extend(contents(&path));
        } else if path.is_file() {
            all.insert(path.clone(), std::fs::read(&path).unwrap());
        }
    }
    all
}

/// Other ways to name a file.
fn spellings(folder: &Path, name: &str) -> Vec<String> {
    let mut all = vec![
        name.to_owned(),
        format!("./{name}"),
        format!("photos/../{name}"),
        folder.join(name).display().to_string(),
    ];
    #[cfg(unix)]
    {
        let extension = Path::new(name).extension().unwrap().to_str().unwrap();
        let (soft, hard) = (format!("soft.{extension}"), format!("hard.{extension}"));
        for link in [&soft, &hard, &"around".to_owned()] {
            drop(std::fs::remove_file(folder.join(link)));
        }
        std::os::unix::fs::symlink(name, folder.join(&soft)).unwrap();
        std::fs::hard_link(folder.join(name), folder.join(&hard)).unwrap();
        std::os::unix::fs::symlink(".", folder.join("around")).unwrap();
        all.extend([soft, hard, format!("around/{name}")]);
    }
    all
}

#[test]
fn no_output_of_any_operation_replaces_an_input() {
    let folder = studio();
    for line in OPERATIONS {
        let mut words: Vec<_> = line.split(' ').chain(["--json", ">r.json"]).collect();
        // only steps have recipes
        if !line.starts_with("demo") && !line.starts_with("run") {
            words.extend(["--recipe", ">recipe-out.json"]);
        }
        let inputs: Vec<_> = words
            .iter()
            .filter_map(|word| word.strip_prefix('<'))
            .collect();
        for input in inputs {
            // of a folder all pictures are read
            let input = if input == "photos" {
                "photos/disc.png"
            } else {
                input
            };
            let spelled = spellings(folder.path(), input);
            let before = contents(folder.path());
            for (at, _) in words
                .iter()
                .enumerate()
                .filter(|(_, word)| word.starts_with('>'))
            {
                for other in &spelled {
                    let mut arguments: Vec<_> = words
                        .iter()
                        .map(|word| word.trim_start_matches(['<', '>']))
                        .collect();
                    arguments[at] = other;
                    let output = ravec(folder.path(), &arguments);
                    assert_refused(&output, 2, &["cannot write", "choose another name"]);
                }
            }
            assert!(contents(folder.path()) == before, "{line}: {input}");
        }
    }
}

#[test]
fn every_operation_is_in_the_table() {
    let mut missing = Vec::new();
    let known = |name: &str| {
        let starts = |line: &&str| line.starts_with(&format!("{name} "));
        OPERATIONS.iter().any(starts) || WITHOUT_INPUTS.contains(&name)
    };
    let mut walk = vec![(String::new(), ravec_cli::command())];
    while let Some((path, command)) = walk.pop() {
        let subcommands: Vec<Command> = command.get_subcommands().cloned().collect();
        for sub in subcommands {
            let name = format!("{path} {}", sub.get_name()).trim().to_owned();
            if sub.has_subcommands() {
                walk.push((name, sub));
            } else if !known(&name) {
                missing.push(name);
            }
        }
    }
    assert!(missing.is_empty(), "add to OPERATIONS: {missing:?}");
}

#[test]
fn a_report_takes_no_file_that_belongs_to_a_catalogue() {
    let folder = studio();
    let before = contents(folder.path());
    for ending in ["-journal", "-wal", "-shm"] {
        let report = format!("photos.ravec{ending}");
        for line in [
            "library stats",
            "library add photos",
            "mosaic a.bmp -o out.png",
        ] {
            let mut arguments: Vec<_> = line.split(' ').collect();
            arguments.extend(["--catalogue", "photos.ravec", "--json", &report]);
            assert_refused(
                &ravec(folder.path(), &arguments),
                2,
                &[&report, "it is an input"],
            );
        }
    }
    assert!(contents(folder.path()) == before);
}

/// The page is the only file of a gallery, and a picture is known by its content, not by its name.
#[test]
fn a_gallery_does_not_replace_the_photo_that_it_shows() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("gallery")).unwrap();
    let page = folder.path().join("gallery/index.html");
    std::fs::copy(folder.path().join("a.bmp"), &page).unwrap();
    let before = std::fs::read(&page).unwrap();
    let arguments = "demo --image gallery/index.html --out gallery --max-side 64";
    let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    assert_refused(&output, 2, &["index.html", "it is an input"]);
    assert!(std::fs::read(&page).unwrap() == before);
}
