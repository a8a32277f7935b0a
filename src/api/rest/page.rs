//! The page at `/` and that of the API at `/docs`, with the files that they load: all of `src/page`, compiled in.

use std::sync::LazyLock;

use serde::Serialize;

use super::document::Document;
use crate::contract::json;
use crate::contract::message::SolveRequest;
use crate::jobs::solve::Solve;
use crate::jobs::{Example, Kind as _, present};

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const IMAGE: &str = "image/svg+xml";

/// Path, media type and content of every file: a file more is a line more.
const FILES: &[(&str, &str, &str)] = &[
    ("/", HTML, include_str!("../../page/index.html")),
    ("/docs", HTML, include_str!("../../page/docs.html")),
    ("/page/answer.js", SCRIPT, include_str!("../../page/answer.js")),
    ("/page/body.js", SCRIPT, include_str!("../../page/body.js")),
    ("/page/docs.css", STYLE, include_str!("../../page/docs.css")),
    ("/page/docs.js", SCRIPT, include_str!("../../page/docs.js")),
    ("/page/dom.js", SCRIPT, include_str!("../../page/dom.js")),
    ("/page/favicon.svg", IMAGE, include_str!("../../page/favicon.svg")),
    ("/page/field.js", SCRIPT, include_str!("../../page/field.js")),
    ("/page/figures.css", STYLE, present::STYLE),
    ("/page/figures.js", SCRIPT, include_str!("../../page/figures.js")),
    ("/page/files.js", SCRIPT, include_str!("../../page/files.js")),
    ("/page/floor.js", SCRIPT, include_str!("../../page/floor.js")),
    ("/page/form.js", SCRIPT, include_str!("../../page/form.js")),
    ("/page/handle.js", SCRIPT, include_str!("../../page/handle.js")),
    ("/page/handover.js", SCRIPT, include_str!("../../page/handover.js")),
    ("/page/main.js", SCRIPT, include_str!("../../page/main.js")),
    ("/page/motion.js", SCRIPT, include_str!("../../page/motion.js")),
    ("/page/plan.js", SCRIPT, include_str!("../../page/plan.js")),
    ("/page/player.js", SCRIPT, include_str!("../../page/player.js")),
    ("/page/problem.js", SCRIPT, include_str!("../../page/problem.js")),
    ("/page/robot.js", SCRIPT, include_str!("../../page/robot.js")),
    ("/page/schema.js", SCRIPT, include_str!("../../page/schema.js")),
    ("/page/search.js", SCRIPT, include_str!("../../page/search.js")),
    ("/page/sheet.js", SCRIPT, include_str!("../../page/sheet.js")),
    ("/page/snippets.js", SCRIPT, include_str!("../../page/snippets.js")),
    ("/page/state.js", SCRIPT, include_str!("../../page/state.js")),
    ("/page/style.css", STYLE, include_str!("../../page/style.css")),
    ("/page/timeline.js", SCRIPT, include_str!("../../page/timeline.js")),
    ("/page/transport.js", SCRIPT, include_str!("../../page/transport.js")),
    ("/page/view.js", SCRIPT, include_str!("../../page/view.js")),
];

/// What is served at which path: the files, and the examples of maneuvers as `/page/presets.json`.
pub(super) fn files() -> &'static [(&'static str, Document)] {
    static ALL: LazyLock<Vec<(&str, Document)>> = LazyLock::new(|| {
        let files = FILES.iter().map(|&(path, media_type, text)| (path, Document::new(media_type, text)));
        files.chain([("/page/presets.json", Document::new("application/json", presets()))]).collect()
    });
    &ALL
}

/// An example as the page reads it.
#[derive(Serialize)]
struct Preset {
    name: &'static str,
    title: &'static str,
    request: SolveRequest,
}

fn presets() -> Vec<u8> {
    let preset = |&Example { name, title, request }: &Example<SolveRequest>| Preset { name, title, request: request() };
    json::write(&Solve::EXAMPLES.iter().map(preset).collect::<Vec<_>>())
}
