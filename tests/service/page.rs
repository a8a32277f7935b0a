//! The page and what it shows: open to everybody, loaded from nowhere else, kept by browsers, and small.

use std::path::Path;

use axum::http::Method;
use sha2::{Digest as _, Sha256};
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::server::ServerSettings;

use crate::support::{Answer, TestServer, instant_solver};

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// All that the page and what it shows may take together, bytes.
const MOST_BYTES: usize = 300_000;

async fn with_key() -> TestServer {
    let api = ApiSettings { keys: ApiKeys::parse("key").unwrap(), ..ApiSettings::default() };
    TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await
}

/// Paths of all files of `src/page` with their media types, and of what is made.
fn documents() -> Vec<(String, &'static str)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/page");
    let mut documents: Vec<(String, &'static str)> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let media_type = match name.rsplit_once('.').unwrap().1 {
                "html" => "text/html; charset=utf-8",
                "js" => "text/javascript; charset=utf-8",
                "css" => "text/css; charset=utf-8",
                "svg" => "image/svg+xml",
                other => panic!("files of the page end in no .{other}"),
            };
            match name.as_str() {
                "index.html" => ("/".to_owned(), media_type),
                "docs.html" => ("/docs".to_owned(), media_type),
                _ => (format!("/page/{name}"), media_type),
            }
        })
        .collect();
    documents.push(("/page/figures.css".to_owned(), "text/css; charset=utf-8"));
    let of_json = ["/page/presets.json", "/openapi.json", "/limits"];
    documents.extend(of_json.map(|path| (path.to_owned(), "application/json")));
    documents
}

#[tokio::test]
async fn every_file_is_served_without_a_key_and_all_are_small() {
    let server = with_key().await;
    let mut bytes = 0;
    for (path, media_type) in documents() {
        let answer = server.get(&path).await;
        assert_eq!((answer.status, answer.header("content-type")), (200, media_type), "{path}");
        assert_eq!(answer.header("content-security-policy"), POLICY, "{path}");
        assert_eq!(answer.header("cache-control"), "no-cache", "{path}");
        let hash: Vec<_> = Sha256::digest(&answer.bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(answer.header("etag"), format!("\"{}\"", hash.concat()), "{path}");
        bytes += answer.bytes.len();
        let head = Answer::of(server.client.request(Method::HEAD, server.url(&path))).await;
        assert_eq!((head.status, head.bytes.len()), (200, 0), "{path}");
        for name in ["content-type", "content-length", "content-security-policy", "cache-control", "etag"] {
            assert_eq!(head.header(name), answer.header(name), "{name} of {path}");
        }
    }
    assert!(bytes <= MOST_BYTES, "the page and what it shows take {bytes} bytes");
}

#[tokio::test]
async fn all_else_needs_a_key() {
    let server = with_key().await;
    for path in ["/examples/forward-drive", "/page", "/docs/", "/limits/", "/pagex", "//"] {
        assert_eq!(server.get(path).await.status, 401, "{path}");
    }
    for path in ["/solve", "/validate", "/present"] {
        assert_eq!(server.post(path, "{}").await.status, 401, "{path}");
    }
}

#[tokio::test]
async fn files_that_do_not_exist_and_other_methods_are_problems() {
    let server = with_key().await;
    for path in ["/page/x", "/page/", "/page/index.html"] {
        let answer = server.get(path).await;
        assert_eq!((answer.status, &answer.problem()["code"]), (404, &"not_found".into()), "{path}");
    }
    for path in ["/", "/docs", "/page/main.js", "/openapi.json"] {
        let answer = server.post(path, "{}").await;
        assert_eq!((answer.status, answer.header("allow")), (405, "GET,HEAD"), "{path}");
    }
}

#[tokio::test]
async fn who_has_a_document_is_told_so() {
    let server = with_key().await;
    for path in ["/", "/page/figures.css", "/openapi.json", "/limits"] {
        let tag = server.get(path).await.header("etag").to_owned();
        let asked = async |lists: &[&str]| {
            let request = server.client.get(server.url(path));
            Answer::of(lists.iter().fold(request, |request, list| request.header("if-none-match", *list))).await
        };
        let (alike, listed, among) = (format!("W/{tag}"), format!("\"a\", {tag} ,\"b\""), format!("\"a\",{tag}"));
        let known: [&[&str]; 6] = [&[&tag], &["*"], &[&alike], &[&listed], &[&among], &["\"a\"", &tag]];
        for lists in known {
            let answer = asked(lists).await;
            assert_eq!((answer.status, answer.bytes.len()), (304, 0), "{path} {lists:?}");
            assert_eq!((answer.header("etag"), answer.header("cache-control")), (tag.as_str(), "no-cache"));
            assert_eq!(answer.header("content-type"), "");
        }
        let bare = tag.trim_matches('"');
        let others: [&[&str]; 4] = [&["\"a\""], &[bare], &[""], &["\"a\", W/\"b\""]];
        for lists in others {
            assert_eq!(asked(lists).await.status, 200, "{path} {lists:?}");
        }
    }
}

#[tokio::test]
async fn nothing_is_loaded_from_elsewhere_or_written_between_the_lines() {
    let server = with_key().await;
    for (path, media_type) in documents() {
        let text = server.get(&path).await.text();
        let spaced = text.split_whitespace().collect::<Vec<_>>().join(" ");
        for place in [
            "href=\"",
            "src=\"",
            "url(",
            "url(\"",
            "url('",
            "from \"",
            "import \"",
            "import(\"",
            "@import \"",
            "fetch(\"",
        ] {
            for elsewhere in ["http:", "https:", "//"] {
                let loads = format!("{place}{elsewhere}");
                assert!(!spaced.contains(&loads), "{path} has {loads}");
            }
        }
        if media_type.starts_with("text/html") {
            for inline in ["<style", " style=", "javascript:", " onclick=", " onload=", " onerror=", "<base"] {
                assert!(!text.contains(inline), "{path} has {inline}");
            }
            for script in text.split("<script").skip(1) {
                let (head, rest) = script.split_once('>').unwrap();
                assert!(head.contains(" src=\"") && rest.starts_with("</script>"), "{path} has a script of its own");
            }
        }
    }
}

#[tokio::test]
async fn presets_are_the_examples() {
    let server = TestServer::start(4, instant_solver()).await;
    let presets = server.get("/page/presets.json").await.json();
    let names: Vec<_> = presets.as_array().unwrap().iter().map(|preset| preset["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["forward-drive", "half-turn", "warehouse-aisle"]);
    for preset in presets.as_array().unwrap() {
        let name = preset["name"].as_str().unwrap();
        assert!(preset["title"].as_str().is_some_and(|title| !title.is_empty()), "{name}");
        assert_eq!(server.get(&format!("/examples/{name}")).await.json(), preset["request"], "{name}");
        let mut validated = server.post("/validate", preset["request"].to_string()).await.json();
        validated.as_object_mut().unwrap().remove("input_hash");
        assert_eq!(validated, preset["request"], "{name}: nothing is left to complete");
    }
}

#[tokio::test]
async fn files_of_the_page_count_together() {
    let server = TestServer::start(4, instant_solver()).await;
    for path in ["/page/main.js", "/page/style.css", "/page/secret"] {
        server.get(path).await;
    }
    let text = String::from_utf8(server.service.metrics_text()).unwrap();
    let count =
        |code: u16| format!("slipdrive_http_request_duration_seconds_count{{code=\"{code}\",route=\"/page/\"}}");
    assert!(text.contains(&format!("{} 2", count(200))) && text.contains(&format!("{} 1", count(404))), "{text}");
    assert!(!text.contains("secret"));
}
