//! Verdicts of operations on meshes, compared with `mesh check` of the files that they wrote.

use crate::meshes;
use crate::program::{code, ravec, stderr};
use serde_json::Value;
use std::path::Path;

/// A mesh in double precision.
struct Drawn {
    places: Vec<[f64; 3]>,
    triangles: Vec<[usize; 3]>,
}

impl Drawn {
    fn obj(&self) -> String {
        let places = self
            .places
            .iter()
            .map(|[x, y, z]| format!("v {x} {y} {z}\n"));
        let triangles = self.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| v + 1);
            format!("f {a} {b} {c}\n")
        });
        places.chain(triangles).collect()
    }
}

/// A box from the origin.
fn cuboid(x: f32, y: f32, z: f32) -> Drawn {
    let mesh = meshes::cuboid(x, y, z);
    Drawn {
        places: mesh.places.iter().map(|p| p.map(f64::from)).collect(),
        triangles: mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| v as usize))
            .collect(),
    }
}

/// The corners moved by a function.
fn moved(mut mesh: Drawn, by: impl Fn([f64; 3]) -> [f64; 3]) -> Drawn {
    for place in &mut mesh.places {
        *place = by(*place);
    }
    mesh
}

/// Turned about two axes by angles that no float represents.
fn askew([x, y, z]: [f64; 3]) -> [f64; 3] {
    let ((s, c), (t, d)) = (0.7f64.sin_cos(), 1.1f64.sin_cos());
    let (x, y) = (c * x - s * y, s * x + c * y);
    [x + 30.0, d * y - t * z - 17.0, t * y + d * z]
}

/// Both meshes in one.
fn together(mut one: Drawn, other: Drawn) -> Drawn {
    let first = one.places.len();
    one.places.extend(other.places);
    let triangles = other.triangles.into_iter();
    one.triangles
        .extend(triangles.map(|t| t.map(|v| v + first)));
    one
}

/// The triangles with corners of their own.
fn shattered(mesh: &Drawn) -> Drawn {
    let corners = mesh.triangles.iter().flatten();
    Drawn {
        places: corners.map(|&v| mesh.places[v]).collect(),
        triangles: (0..mesh.triangles.len())
            .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
            .collect(),
    }
}

/// Meshes of the kinds that make verdicts go wrong.
fn cases() -> Vec<(&'static str, Drawn)> {
    let shift = |mesh, by: [f64; 3]| moved(mesh, |p| std::array::from_fn(|i| p[i] + by[i]));
    let plate = || cuboid(9.0, 7.0, 2.0);
    let touching = together(
        cuboid(2.0, 2.0, 2.0),
        shift(cuboid(2.0, 2.0, 2.0), [2.0, 2.0, 0.0]),
    );
    let crossing = together(
        cuboid(2.0, 2.0, 2.0),
        shift(cuboid(2.0, 2.0, 2.0), [1.0; 3]),
    );
    let mut open = plate();
    open.triangles.truncate(10);
    let mut turned = plate();
    for t in &mut turned.triangles {
        t.swap(0, 1);
    }
    vec![
        ("plate", moved(plate(), askew)),
        (
            "pocket",
            moved(shift(cuboid(3.0, 2.0, 1.0), [0.4, 0.2, 1.0]), askew),
        ),
        (
            "boss",
            moved(shift(cuboid(3.0, 2.0, 1.0), [0.4, 0.2, 2.0]), askew),
        ),
        ("touching", touching),
        ("crossing", crossing),
        (
            "nested",
            together(plate(), shift(cuboid(1.0, 1.0, 1.0), [1.0, 1.0, 0.5])),
        ),
        ("shattered", shattered(&plate())),
        ("open", open),
        ("inside_out", turned),
    ]
}

/// Runs a command that may end without its promise; gives the report if it wrote a file.
fn run(folder: &Path, line: &str) -> Option<(i32, Value)> {
    let mut arguments: Vec<_> = line.split(' ').collect();
    arguments.extend(["-q", "--json", "report.json"]);
    let output = ravec(folder, &arguments);
    let code = code(&output);
    if code != 0 && code != 1 && code != 5 {
        // a refusal names the cure in one sentence
        assert_eq!(code, 3, "{line}: {}", stderr(&output));
        return None;
    }
    let text = std::fs::read_to_string(folder.join("report.json")).unwrap();
    std::fs::remove_file(folder.join("report.json")).unwrap();
    Some((code, serde_json::from_str(&text).unwrap()))
}

/// Asserts that a verdict is that of `mesh check`; gives false if nothing was written.
fn judge(folder: &Path, line: &str, out: &str) -> bool {
    let Some((code, report)) = run(folder, &format!("{line} -o {out}")) else {
        return false;
    };
    let (found, check) = run(folder, &format!("mesh check {out}")).unwrap();
    let name = format!("{line} {out}: {report} {check}");
    assert_eq!(code == 5, report["passed"] == false, "{name}");
    let is_empty = report["figures"]["triangles"] == 0.0;
    let verdict = &report["verdict"];
    if let Some(solid) = verdict["solid"].as_bool() {
        assert_eq!(solid, found == 0, "{name}");
    }
    if let Some(closed) = verdict["closed"].as_bool() {
        assert_eq!(check["verdict"]["closed"], closed, "{name}");
    }
    if report["passed"] == true && !is_empty {
        assert_eq!((code, found), (0, 0), "{name}");
    }
    for kind in ["changed", "dropped", "assumed"] {
        for sentence in verdict[kind].as_array().unwrap() {
            let warnings = report["warnings"].as_array().unwrap();
            assert!(warnings.contains(sentence), "{name}");
        }
    }
    true
}

#[test]
fn verdicts_of_mesh_operations_are_those_of_check() {
    let folder = tempfile::tempdir().unwrap();
    let cases = cases();
    for (name, mesh) in &cases {
        std::fs::write(folder.path().join(format!("{name}.obj")), mesh.obj()).unwrap();
    }
    let names: Vec<_> = cases.iter().map(|(name, _)| *name).collect();
    for out in ["out.stl", "out.off", "out.3mf", "out.glb"] {
        for pair in [
            "plate.obj pocket.obj",
            "plate.obj boss.obj",
            "touching.obj touching.obj",
            "crossing.obj open.obj",
            "nested.obj shattered.obj",
            "shattered.obj inside_out.obj",
        ] {
            for expression in ["a|b", "a-b", "a&b", "a^b"] {
                let line = format!("boolean {expression} {pair}");
                assert!(judge(folder.path(), &line, out), "{line}");
            }
        }
        for name in &names {
            for line in [
                format!("mesh convert {name}.obj"),
                format!("mesh simplify {name}.obj --error 1%"),
            ] {
                assert!(judge(folder.path(), &line, out), "{line}");
            }
        }
    }
    for name in &names {
        for side in ["outer", "inner", "shell", "both"] {
            let line = format!("offset {name}.obj --distance 2% --tolerance 0.5% --side {side}");
            let written = judge(folder.path(), &line, "out.stl");
            assert!(written || *name == "open" && side != "both", "{line}");
        }
    }
}
