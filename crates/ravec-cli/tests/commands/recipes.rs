//! `run` and `--recipe`: operations as data.

use crate::meshes::parts;
use crate::program::{assert_refused, code, done, folder, ravec, report, stderr};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

fn put(folder: &Path, steps: &Value) {
    let recipe = json!({ "version": 1, "steps": steps });
    fs::write(folder.join("recipe.json"), recipe.to_string()).unwrap();
}

#[test]
fn a_recipe_repeats_the_command_that_wrote_it() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    done(
        folder.path(),
        "-q retarget a.bmp -o out.png --size 75%x100% --recipe recipe.json",
    );
    let bytes = fs::read(at("out.png")).unwrap();
    fs::remove_file(at("out.png")).unwrap();
    let first = report(folder.path(), "run recipe.json");
    assert_eq!(fs::read(at("out.png")).unwrap(), bytes);
    assert_eq!(first["outputs"][0]["path"], "out.png");
    assert_eq!(first["steps"][0]["operation"], "retarget");
    // the report of a run holds the recipe that repeats it
    let inner = &first["steps"][0]["recipe"];
    fs::write(at("again.json"), inner.to_string()).unwrap();
    fs::remove_file(at("out.png")).unwrap();
    done(folder.path(), "-q run again.json");
    assert_eq!(fs::read(at("out.png")).unwrap(), bytes);
}

#[test]
fn intermediate_results_stay_in_memory_and_give_the_bytes_of_lossless_files() {
    let folder = folder();
    parts(folder.path());
    let at = |name: &str| folder.path().join(name);
    let chain = |picture: &str, mesh: &str, out: &str| {
        json!([
            { "operation": "brush", "input": "a.bmp", "output": picture, "everywhere": true,
              "params": { "mode": "smooth" } },
            { "operation": "twocolor", "input": picture, "output": format!("{out}.png") },
            { "operation": "mesh convert", "input": "part.stl", "output": mesh },
            { "operation": "offset", "input": mesh, "output": format!("{out}.ply"),
              "params": { "distance": "3%" } },
        ])
    };
    put(folder.path(), &chain("step.png", "step.ply", "files"));
    done(folder.path(), "-q run recipe.json");
    put(folder.path(), &chain("@step", "@mesh", "memory"));
    let report = report(folder.path(), "run recipe.json");
    for ending in ["png", "ply"] {
        let [files, memory] = ["files", "memory"].map(|name| at(&format!("{name}.{ending}")));
        assert!(
            fs::read(files).unwrap() == fs::read(memory).unwrap(),
            "{ending}"
        );
    }
    assert!(!at("@step").exists() && !at("@mesh").exists());
    assert_eq!(report["passed"], true);
    assert_eq!(report["outputs"].as_array().unwrap().len(), 2);
    assert_eq!(report["steps"][0]["outputs"][0]["format"], "in memory");
    assert_eq!(report["steps"][3]["inputs"][0]["path"], "@mesh");
}

#[test]
fn a_dry_run_lists_files_and_writes_none() {
    let folder = folder();
    fs::write(folder.path().join("old.png"), "x").unwrap();
    let steps = json!([
        { "operation": "brush", "input": "a.bmp", "output": "@b", "everywhere": true },
        { "operation": "twocolor", "input": "@b", "output": "old.png", "svg": "new.svg" },
        { "operation": "scenes", "out": "scenes" },
    ]);
    put(folder.path(), &steps);
    let text = done(folder.path(), "run recipe.json --dry-run");
    for line in [
        "  reads   a.bmp",
        "  writes  @b (in memory)",
        "  writes  old.png (replaces a file)",
        "  writes  new.svg (new file)",
        "  writes  scenes (new folder)",
    ] {
        assert!(text.contains(line), "{text}");
    }
    let planned = report(folder.path(), "run recipe.json --dry-run");
    assert_eq!(
        planned["result"][1]["outputs"][0]["state"],
        "replaces a file"
    );
    assert_eq!(fs::read(folder.path().join("old.png")).unwrap(), b"x");
    assert!(!folder.path().join("new.svg").exists() && !folder.path().join("scenes").exists());
}

#[test]
fn a_failed_step_and_a_verdict_of_no_end_the_run() {
    let folder = folder();
    parts(folder.path());
    let sheet = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    fs::write(folder.path().join("sheet.off"), sheet).unwrap();
    let convert =
        |name: &str| json!({ "operation": "mesh convert", "input": "part.stl", "output": name });
    let check = json!({ "operation": "mesh check", "input": "sheet.off" });
    put(
        folder.path(),
        &json!([convert("1.ply"), check, convert("2.ply")]),
    );
    let output = ravec(folder.path(), &["run", "recipe.json"]);
    assert_eq!(code(&output), 1, "{}", stderr(&output));
    assert!(stderr(&output).contains("ended after step 2 (mesh check)"));
    assert!(folder.path().join("1.ply").exists() && !folder.path().join("2.ply").exists());
    let failing = json!({ "operation": "mesh info", "input": "missing.stl" });
    put(folder.path(), &json!([failing, convert("2.ply")]));
    let output = ravec(folder.path(), &["run", "recipe.json"]);
    assert_refused(&output, 3, &["step 1:", "missing.stl"]);
    assert!(!folder.path().join("2.ply").exists());
}

#[test]
fn recipes_that_cannot_run_are_refused_before_their_first_step() {
    let folder = folder();
    let twocolor = |input: &str, output: &str| json!({ "operation": "twocolor", "input": input, "output": output });
    let first = twocolor("a.bmp", "first.png");
    for (steps, expected, words) in [
        (
            json!([first, twocolor("first.png", "a.bmp")]),
            2,
            "it is an input",
        ),
        (
            json!([first, twocolor("b.bmp", "first.png")]),
            2,
            "two outputs",
        ),
        (
            json!([first, twocolor("b.bmp", "recipe.json")]),
            2,
            "it is an input",
        ),
        (
            json!([first, twocolor("@x", "x.png")]),
            3,
            "@x is not an output of an earlier step",
        ),
        (
            json!([first, { "operation": "blur" }]),
            3,
            "step 2: there is no operation",
        ),
        (
            json!([first, { "operation": "twocolor", "input": "a", "outpt": "b" }]),
            3,
            "outpt",
        ),
        (json!([first, { "input": "a.bmp" }]), 3, "`operation`"),
        (
            json!([first, { "operation": "twocolor", "input": "a", "params": { "size": "x" } }]),
            3,
            "step 2:",
        ),
    ] {
        put(folder.path(), &steps);
        let output = ravec(folder.path(), &["run", "recipe.json"]);
        assert_refused(&output, expected, &[words]);
        assert!(!folder.path().join("first.png").exists(), "{words}");
    }
    for (text, words) in [
        ("{", "EOF"),
        ("", "empty"),
        (r#"{"version": 2, "steps": []}"#, "version is 2"),
    ] {
        fs::write(folder.path().join("recipe.json"), text).unwrap();
        let output = ravec(folder.path(), &["run", "recipe.json"]);
        assert_refused(&output, 3, &["cannot use the recipe in recipe.json", words]);
    }
}

#[test]
fn a_mosaic_stays_in_memory_and_its_page_does_not() {
    let folder = folder();
    done(
        folder.path(),
        "-q library add a.bmp b.bmp --catalogue photos.ravec",
    );
    let params = json!({ "tiles": "4x3", "tile_size": "16x12", "min_repeat_distance": 0.0, "crop": "center" });
    put(
        folder.path(),
        &json!([
            { "operation": "mosaic", "input": "a.bmp", "catalogue": "photos.ravec", "output": "@m", "params": params },
            { "operation": "twocolor", "input": "@m", "output": "one.png" }
        ]),
    );
    done(folder.path(), "-q run recipe.json");
    done(
        folder.path(),
        "-q mosaic a.bmp --catalogue photos.ravec -o m.png --tiles 4x3 --tile-size 16x12 --min-repeat-distance 0 --crop center",
    );
    done(folder.path(), "-q twocolor m.png -o two.png");
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(read("one.png") == read("two.png"));
    put(
        folder.path(),
        &json!([{ "operation": "mosaic", "input": "a.bmp", "catalogue": "photos.ravec", "deep_zoom": "@z" }]),
    );
    let output = ravec(folder.path(), &["run", "recipe.json"]);
    assert_refused(&output, 2, &["@z cannot stay in memory"]);
}
