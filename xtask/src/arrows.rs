//! Who may depend on whom.
//!
//! One table says it, for the program here and for the reader in `docs/architecture.md`; a test keeps the two equal.
//! Everything that is not in the table is refused, so that a new arrow or a new crate is a decision and not an accident.

use cargo_metadata::{Dependency, DependencyKind, Metadata};

/// A crate of the workspace and the arrows that leave it.
struct Crate {
    name: &'static str,
    layer: &'static str,
    uses: &'static [&'static str],
}

/// Every crate from the floor up. Tests, examples and benchmarks may use [`DEVELOPMENT`] as well.
const CRATES: &[Crate] = &[
    Crate {
        name: "ravec-progress",
        layer: "floor",
        uses: &[],
    },
    Crate {
        name: "ravec-memory",
        layer: "floor",
        uses: &["ravec-progress"],
    },
    Crate {
        name: "ravec-files",
        layer: "floor",
        uses: &[],
    },
    Crate {
        name: "ravec-pieces",
        layer: "floor",
        uses: &["ravec-files", "ravec-progress"],
    },
    Crate {
        name: "ravec-numeric",
        layer: "floor",
        uses: &[],
    },
    Crate {
        name: "ravec-raster",
        layer: "vocabulary",
        uses: &["ravec-progress"],
    },
    Crate {
        name: "ravec-media",
        layer: "vocabulary",
        uses: &[
            "ravec-raster",
            "ravec-files",
            "ravec-memory",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-video",
        layer: "vocabulary",
        uses: &[
            "ravec-media",
            "ravec-raster",
            "ravec-files",
            "ravec-memory",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-mesh",
        layer: "vocabulary",
        uses: &["ravec-memory", "ravec-numeric", "ravec-progress"],
    },
    // offsets and Booleans use meshes, and compile no codec
    Crate {
        name: "ravec-mesh-io",
        layer: "vocabulary",
        uses: &[
            "ravec-mesh",
            "ravec-files",
            "ravec-memory",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-mesh-render",
        layer: "vocabulary",
        uses: &["ravec-mesh", "ravec-progress"],
    },
    Crate {
        name: "ravec-twocolor",
        layer: "representations",
        uses: &["ravec-raster", "ravec-progress"],
    },
    Crate {
        name: "ravec-planar",
        layer: "representations",
        uses: &["ravec-raster", "ravec-numeric", "ravec-progress"],
    },
    Crate {
        name: "ravec-octree",
        layer: "representations",
        uses: &[],
    },
    Crate {
        name: "ravec-offset",
        layer: "systems",
        uses: &[
            "ravec-mesh",
            "ravec-octree",
            "ravec-numeric",
            "ravec-pieces",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-boolean",
        layer: "systems",
        uses: &["ravec-mesh", "ravec-numeric", "ravec-progress"],
    },
    Crate {
        name: "ravec-completion",
        layer: "systems",
        uses: &[
            "ravec-planar",
            "ravec-raster",
            "ravec-numeric",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-retarget",
        layer: "systems",
        uses: &[
            "ravec-twocolor",
            "ravec-raster",
            "ravec-numeric",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-mosaic",
        layer: "systems",
        uses: &["ravec-twocolor", "ravec-raster", "ravec-progress"],
    },
    Crate {
        name: "ravec-matting",
        layer: "systems",
        uses: &["ravec-raster", "ravec-numeric", "ravec-progress"],
    },
    Crate {
        name: "ravec-video-edit",
        layer: "assembly",
        uses: &[
            "ravec-completion",
            "ravec-matting",
            "ravec-planar",
            "ravec-raster",
            "ravec-numeric",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-gpu",
        layer: "assembly",
        uses: &[
            "ravec-twocolor",
            "ravec-planar",
            "ravec-retarget",
            "ravec-raster",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-catalogue",
        layer: "assembly",
        uses: &[
            "ravec-mosaic",
            "ravec-media",
            "ravec-raster",
            "ravec-files",
            "ravec-memory",
            "ravec-pieces",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec",
        layer: "assembly",
        uses: &[
            "ravec-twocolor",
            "ravec-planar",
            "ravec-completion",
            "ravec-matting",
            "ravec-video-edit",
            "ravec-retarget",
            "ravec-mosaic",
            "ravec-offset",
            "ravec-boolean",
            "ravec-mesh",
            "ravec-mesh-io",
            "ravec-mesh-render",
            "ravec-raster",
            "ravec-gpu",
            "ravec-memory",
            "ravec-pieces",
            "ravec-progress",
        ],
    },
    Crate {
        name: "ravec-jobs",
        layer: "assembly",
        uses: &[
            "ravec",
            "ravec-catalogue",
            "ravec-media",
            "ravec-video",
            "ravec-files",
            "ravec-scenes",
        ],
    },
    Crate {
        name: "ravec-demo",
        layer: "assembly",
        uses: &["ravec", "ravec-jobs", "ravec-media", "ravec-scenes"],
    },
    Crate {
        name: "ravec-cli",
        layer: "fronts",
        uses: &["ravec-demo", "ravec-jobs", "ravec"],
    },
    Crate {
        name: "ravec-studio",
        layer: "fronts",
        uses: &[
            "ravec-jobs",
            "ravec",
            "ravec-media",
            "ravec-video",
            "ravec-files",
        ],
    },
    Crate {
        name: "ravec-python",
        layer: "fronts",
        uses: &["ravec-cli", "ravec-jobs", "ravec", "ravec-media"],
    },
    Crate {
        name: "ravec-scenes",
        layer: "development",
        uses: &["ravec-raster", "ravec-mesh"],
    },
    Crate {
        name: "xtask",
        layer: "development",
        uses: &[],
    },
];

/// Crates that any crate may use in its tests, examples and benchmarks: scenes whose truth is known, and files as others get
/// them.
const DEVELOPMENT: &[&str] = &["ravec-scenes", "ravec-mesh-io"];

/// Foreign crates that are kept in one place, and the crates that may use them.
const QUARANTINE: &[(&[&str], &[&str])] = &[
    // codecs of pictures
    (
        &[
            "exr",
            "image",
            "img-parts",
            "jpeg-decoder",
            "jpeg-encoder",
            "kamadak-exif",
            "moxcms",
            "tiff",
            "zune-jpeg",
        ],
        &["ravec-media"],
    ),
    // animated ones, which are read frame by frame
    (&["png"], &["ravec-media", "ravec-video"]),
    // codecs of video
    (&["gif", "openh264"], &["ravec-video"]),
    // temporary files
    (&["tempfile"], &["ravec-files"]),
    // codecs of meshes
    (&["quick-xml", "zip"], &["ravec-mesh-io"]),
    // the inflater of archives, and the checksum of PNG chunks
    (&["flate2"], &["ravec-mesh-io", "ravec-video"]),
    // the memory of the machine
    (&["sysinfo"], &["ravec-memory"]),
    // the catalogue of photos
    (&["blake3", "rusqlite", "walkdir"], &["ravec-catalogue"]),
    // errors that are only shown
    (&["anyhow"], &["ravec-cli", "ravec-scenes", "xtask"]),
    // flags of the command line, derived for parameter types behind a feature
    (
        &["clap"],
        &[
            "ravec-boolean",
            "ravec-cli",
            "ravec-demo",
            "ravec-jobs",
            "ravec-matting",
            "ravec-mesh-io",
            "ravec-mesh-render",
            "ravec-mosaic",
            "ravec-offset",
            "ravec-planar",
            "ravec-retarget",
            "ravec-studio",
            "ravec-video-edit",
            "xtask",
        ],
    ),
    // devices beside the CPU
    (
        &["pollster", "wgpu"],
        &["ravec-gpu", "ravec-mesh-render", "ravec-studio"],
    ),
    // the interpreter of Python
    (&["numpy", "pyo3"], &["ravec-python"]),
    // windows
    (&["eframe", "egui", "egui_kittest"], &["ravec-studio"]),
    // the terminal
    (
        &[
            "clap_complete",
            "clap_mangen",
            "ctrlc",
            "indicatif",
            "tracing-subscriber",
        ],
        &["ravec-cli"],
    ),
];

/// The crate whose optional dependencies use nothing and only ask for features; see `shared-build` in its manifest.
const ASKS_FOR_FEATURES: &str = "ravec-python";

/// Each dependency that the rules refuse, as a sentence.
pub fn refused(metadata: &Metadata) -> Vec<String> {
    let mut refused = Vec::new();
    for package in metadata.workspace_packages() {
        for dependency in &package.dependencies {
            if let Err(reason) = judge(&package.name, dependency) {
                refused.push(format!("{} -> {}: {reason}", package.name, dependency.name));
            }
        }
        if !CRATES
            .iter()
            .any(|known| known.name == package.name.as_str())
        {
            refused.push(format!("{}: the crate is not in the table", package.name));
        }
    }
    refused
}

/// True if `from` may depend on `dependency`.
fn judge(from: &str, dependency: &Dependency) -> Result<(), &'static str> {
    let to = dependency.name.as_str();
    let for_tests = dependency.kind == DependencyKind::Development;
    if dependency.optional && from == ASKS_FOR_FEATURES {
        return Ok(());
    }
    if dependency.path.is_some() {
        let allowed = |list: &[&str]| list.contains(&to);
        let uses = CRATES
            .iter()
            .find(|known| known.name == from)
            .map_or(&[][..], |known| known.uses);
        return if allowed(uses) || (for_tests && allowed(DEVELOPMENT)) {
            Ok(())
        } else {
            Err("the arrow is not in the table")
        };
    }
    // A test may write a temporary file or decode a picture to look at it.
    let kept_from_it = QUARANTINE
        .iter()
        .any(|(foreign, users)| foreign.contains(&to) && !users.contains(&from));
    if kept_from_it && !for_tests {
        Err("the foreign crate is kept in other crates")
    } else {
        Ok(())
    }
}

/// The table as it stands in `docs/architecture.md`.
pub fn markdown() -> String {
    let header = "| layer | crate | may depend on |\n| --- | --- | --- |\n".to_owned();
    CRATES.iter().fold(header, |table, known| {
        let Crate { name, layer, uses } = known;
        let uses: Vec<_> = uses.iter().map(|name| format!("`{name}`")).collect();
        let uses = if uses.is_empty() {
            "nothing of ours".to_owned()
        } else {
            uses.join(", ")
        };
        format!("{table}| {layer} | `{name}` | {uses} |\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dependency(name: &str, kind: &str, path: Option<&str>) -> Dependency {
        let path = path.map_or(String::new(), |path| format!(r#","path":"{path}""#));
        let json = format!(
            r#"{{"name":"{name}","req":"*","kind":{kind},"optional":false,
                "uses_default_features":true,"features":[],"source":null,"target":null{path}}}"#
        );
        cargo_metadata::MetadataCommand::parse(format!(
            r#"{{"packages":[{{"name":"p","version":"0.0.0","id":"p","manifest_path":"/p",
                "dependencies":[{json}],"targets":[],"features":{{}}}}],
                "workspace_members":["p"],"resolve":null,"target_directory":"/t",
                "workspace_root":"/","version":1}}"#
        ))
        .unwrap()
        .packages[0]
            .dependencies[0]
            .clone()
    }

    #[test]
    fn the_table_in_the_docs_is_the_one_that_is_checked() {
        let docs = include_str!("../../docs/architecture.md");
        let table = markdown();
        assert!(
            docs.contains(&table),
            "docs/architecture.md must hold exactly this table:\n{table}"
        );
    }

    #[test]
    fn arrows_of_the_table_point_at_crates_of_the_table() {
        for Crate { name, uses, .. } in CRATES {
            for used in *uses {
                assert!(
                    CRATES.iter().any(|known| known.name == *used),
                    "{name} -> {used}"
                );
            }
        }
    }

    #[test]
    fn a_system_may_not_use_a_front_nor_files() {
        let here = Some("/x");
        for to in [
            "ravec-cli",
            "ravec-media",
            "ravec-files",
            "ravec-scenes",
            "ravec-unknown",
        ] {
            let arrow = dependency(to, "null", here);
            assert!(judge("ravec-twocolor", &arrow).is_err(), "{to}");
        }
        assert!(judge("ravec-twocolor", &dependency("ravec-raster", "null", here)).is_ok());
        assert!(judge("ravec-unknown", &dependency("ravec-raster", "null", here)).is_err());
    }

    #[test]
    fn tests_may_use_scenes_and_foreign_crates_but_no_front() {
        let here = Some("/x");
        let scenes = dependency("ravec-scenes", r#""dev""#, here);
        assert!(judge("ravec-twocolor", &scenes).is_ok());
        let codec = dependency("image", r#""dev""#, None);
        assert!(judge("ravec-cli", &codec).is_ok());
        let front = dependency("ravec-cli", r#""dev""#, here);
        assert!(judge("ravec-twocolor", &front).is_err());
    }

    #[test]
    fn codecs_stay_in_media_and_shown_errors_in_fronts() {
        for (from, to, accepted) in [
            ("ravec-media", "image", true),
            ("ravec-raster", "image", false),
            ("ravec-cli", "anyhow", true),
            ("ravec-jobs", "anyhow", false),
            ("ravec-jobs", "serde", true),
            ("ravec-mesh-io", "zip", true),
            ("ravec-mesh", "zip", false),
            ("ravec-media", "tempfile", false),
            ("ravec-twocolor", "clap", false),
            ("ravec-offset", "clap", true),
        ] {
            for kind in ["null", r#""build""#] {
                let verdict = judge(from, &dependency(to, kind, None));
                assert_eq!(verdict.is_ok(), accepted, "{from} -> {to} ({kind})");
            }
        }
    }
}
