//! Who may know whom: reads the paths in `src` and fails on an edge that the table does not allow.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// One row of the table.
struct Module {
    name: &'static str,
    may_use: &'static [&'static str],
    /// Words that must not appear in its code at all.
    must_not_mention: &'static [&'static str],
}

/// The numerics take seeds, stop flags and observers as arguments: no runtime, wire format, clock, thread or
/// unseeded randomness of their own.
const FOREIGN_TO_NUMERICS: &[&str] = &[
    "tokio",
    "serde",
    "axum",
    "tonic",
    "prost",
    "tracing",
    "std::time",
    "std::thread",
    "std::env",
    "std::fs",
    "thread_rng",
    "rand::rng",
    "ThreadRng",
    "println!",
    "eprintln!",
];

const TABLE: &[Module] = &[
    Module { name: "rules", may_use: &[], must_not_mention: FOREIGN_TO_NUMERICS },
    Module { name: "stop", may_use: &[], must_not_mention: FOREIGN_TO_NUMERICS },
    Module { name: "contact", may_use: &["stop"], must_not_mention: FOREIGN_TO_NUMERICS },
    Module { name: "optimizer", may_use: &["stop"], must_not_mention: FOREIGN_TO_NUMERICS },
    Module { name: "robot", may_use: &["rules"], must_not_mention: FOREIGN_TO_NUMERICS },
    Module { name: "simulation", may_use: &["robot", "contact", "stop"], must_not_mention: FOREIGN_TO_NUMERICS },
    Module {
        name: "shooting",
        may_use: &["simulation", "robot", "contact", "optimizer", "rules", "stop"],
        must_not_mention: FOREIGN_TO_NUMERICS,
    },
    Module {
        name: "motion",
        may_use: &["shooting", "optimizer", "simulation", "robot", "rules", "stop"],
        must_not_mention: FOREIGN_TO_NUMERICS,
    },
    Module {
        name: "solver",
        may_use: &["motion", "shooting", "optimizer", "simulation", "robot", "contact", "rules", "stop"],
        must_not_mention: FOREIGN_TO_NUMERICS,
    },
    Module {
        name: "assessment",
        may_use: &["solver", "motion", "shooting", "simulation", "robot", "stop"],
        must_not_mention: FOREIGN_TO_NUMERICS,
    },
    Module {
        name: "prelude",
        may_use: &["solver", "motion", "shooting", "simulation", "robot", "rules"],
        must_not_mention: FOREIGN_TO_NUMERICS,
    },
    Module {
        name: "plot",
        may_use: &["shooting", "simulation", "robot", "contact"],
        must_not_mention: FOREIGN_TO_NUMERICS,
    },
    Module {
        name: "contract",
        may_use: &["solver", "motion", "shooting", "simulation", "robot", "contact", "rules"],
        must_not_mention: &["axum", "tonic", "hyper", "tower", "tokio", "std::thread"],
    },
    Module { name: "queue", may_use: &[], must_not_mention: &["axum", "tonic", "serde", "prost", "nalgebra"] },
    Module {
        name: "metrics",
        may_use: &[],
        must_not_mention: &["axum", "tonic", "serde", "prost", "hyper", "tokio", "nalgebra"],
    },
    Module {
        name: "service",
        may_use: &["queue", "metrics"],
        must_not_mention: &["axum", "tonic", "serde", "prost", "hyper", "nalgebra"],
    },
    Module {
        name: "jobs",
        may_use: &[
            "contract",
            "service",
            "metrics",
            "rules",
            "plot",
            "assessment",
            "solver",
            "motion",
            "shooting",
            "simulation",
            "robot",
            "contact",
            "stop",
        ],
        must_not_mention: &["axum", "tonic", "hyper", "tower", "tokio", "std::thread"],
    },
    Module {
        name: "sweep",
        may_use: &["jobs", "contract", "service", "metrics", "rules", "plot"],
        must_not_mention: &["axum", "tonic", "hyper", "tower", "prost", "nalgebra"],
    },
    Module {
        name: "api",
        may_use: &["jobs", "contract", "service", "metrics", "rules"],
        must_not_mention: &["std::thread", "spawn_blocking"],
    },
];

/// Folders and files inside a module that know less than the module does. Paths are below `src`.
const FOLDERS: &[(&str, &[&str])] = &[
    ("api/rest", &["tonic", "prost", "api::grpc"]),
    ("api/grpc", &["serde", "serde_json", "api::rest"]),
    ("api/batch.rs", &["tonic", "prost", "serde", "serde_json", "api::rest", "api::grpc"]),
    ("api/read_ahead.rs", &["tonic", "prost", "serde", "serde_json", "api::rest", "api::grpc"]),
    ("api/submit.rs", &["tonic", "prost", "serde", "serde_json", "api::rest", "api::grpc"]),
    ("api/server", &["tonic", "prost", "serde", "crate::service", "api::rest", "api::grpc"]),
    ("jobs/solve", &["jobs::simulate"]),
];

/// The program around the library may use what it needs.
const PROGRAM: &[&str] = &["lib", "main", "cli", "config", "health", "heap", "reload", "shutdown", "telemetry"];

#[test]
fn modules_use_only_what_the_table_allows() {
    let mut faults = Vec::new();
    for (file, module) in files_of_modules() {
        let Some(row) = TABLE.iter().find(|row| row.name == module) else {
            assert!(PROGRAM.contains(&module.as_str()), "{}: the table has no row `{module}`", file.display());
            continue;
        };
        for used in modules_named_in(&code_of(&file)) {
            if used != module && !row.may_use.contains(&used.as_str()) {
                faults.push(format!("{}: `{module}` must not use `{used}`", file.display()));
            }
        }
    }
    assert!(faults.is_empty(), "forbidden edges:\n{}", faults.join("\n"));
}

#[test]
fn modules_do_not_mention_what_is_foreign_to_them() {
    let mut faults = Vec::new();
    for (file, module) in files_of_modules() {
        let words = TABLE.iter().find(|row| row.name == module).map_or(&[][..], |row| row.must_not_mention);
        let code = code_of(&file);
        for word in words.iter().filter(|word| mentions(&code, word)) {
            faults.push(format!("{}: `{module}` must not mention `{word}`", file.display()));
        }
    }
    assert!(faults.is_empty(), "foreign words:\n{}", faults.join("\n"));
}

#[test]
fn folders_do_not_mention_what_is_foreign_to_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for (folder, words) in FOLDERS {
        let mut files = Vec::new();
        match root.join(folder) {
            file if file.is_file() => files.push(file),
            folder => collect(&folder, &mut files),
        }
        assert!(!files.is_empty(), "{folder} has no files");
        for file in files {
            let code = code_of(&file);
            let found: Vec<_> = words.iter().filter(|word| mentions(&code, word)).collect();
            assert!(found.is_empty(), "{}: `{folder}` must not mention {found:?}", file.display());
        }
    }
}

#[test]
fn modules_form_no_cycle() {
    for row in TABLE {
        let mut reached = BTreeSet::new();
        let mut open = row.may_use.to_vec();
        while let Some(name) = open.pop() {
            assert_ne!(name, row.name, "`{name}` may use itself through others");
            if reached.insert(name) {
                open.extend(TABLE.iter().filter(|other| other.name == name).flat_map(|other| other.may_use));
            }
        }
    }
}

#[test]
fn files_stay_readable() {
    for (file, _) in files_of_modules() {
        let lines = fs::read_to_string(&file).unwrap().lines().count();
        assert!(lines <= 450, "{} has {lines} lines: split it", file.display());
    }
}

#[test]
fn paths_are_found_in_all_their_forms() {
    let code =
        "use crate::robot::Robot;\nuse crate::{contact, solver::{Status}, self};\nlet x = crate::queue::Queue;\n";
    let expected = ["contact", "queue", "robot", "solver"];
    assert_eq!(modules_named_in(code).into_iter().collect::<Vec<_>>(), expected);
    assert!(mentions("use tokio::time;", "tokio") && !mentions("let tokio_like = 1;", "tokio"));
}

fn files_of_modules() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    collect(&root, &mut files);
    assert!(files.len() > 20, "the sources are found");
    files
        .into_iter()
        .map(|file| {
            let first = file.strip_prefix(&root).unwrap().components().next().unwrap();
            let module = Path::new(first.as_os_str()).file_stem().unwrap().to_str().unwrap().to_owned();
            (file, module)
        })
        .collect()
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// The file without comments and without its unit tests, which may use what they like.
fn code_of(file: &Path) -> String {
    if file.file_stem().is_some_and(|stem| stem == "tests") {
        return String::new();
    }
    let text = fs::read_to_string(file).unwrap();
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let without_comment = |line: &str| line.split("//").next().unwrap_or_default().to_owned();
    code.lines().map(without_comment).collect::<Vec<_>>().join("\n")
}

/// The first segments of all `crate::` paths, braces included.
fn modules_named_in(code: &str) -> BTreeSet<String> {
    let mut modules = BTreeSet::new();
    for rest in code.split("crate::").skip(1) {
        match rest.strip_prefix('{') {
            Some(group) => modules.extend(first_segments(group)),
            None => modules.extend(leading_word(rest)),
        }
    }
    modules.remove("self");
    modules
}

/// The first segments of the paths in a group, up to its closing brace.
fn first_segments(group: &str) -> Vec<String> {
    let (mut depth, mut start, mut segments) = (0, 0, Vec::new());
    for (position, character) in group.char_indices() {
        match character {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                segments.extend(leading_word(group[start..position].trim_start()));
                start = position + 1;
                if character == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    segments
}

fn leading_word(text: &str) -> Option<String> {
    let word: String = text.chars().take_while(|&character| is_word(character)).collect();
    (!word.is_empty()).then_some(word)
}

/// Whether `word` stands in the code by itself, not as a part of a longer name.
fn mentions(code: &str, word: &str) -> bool {
    code.match_indices(word).any(|(position, _)| {
        let before = code[..position].chars().next_back();
        let after = code[position + word.len()..].chars().next();
        !before.is_some_and(is_word) && !after.is_some_and(is_word)
    })
}

fn is_word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}
