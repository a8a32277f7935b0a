//! Answers in gzip: for those who accept it, with the length known, and the same once decoded.

use std::io::Read as _;

use axum::http::Method;
use flate2::read::GzDecoder;
use serde_json::json;

use crate::support::lines::batch;
use crate::support::{TestServer, instant_solver};

/// An answer as it came.
struct Raw {
    status: u16,
    headers: reqwest::header::HeaderMap,
    bytes: Vec<u8>,
}

impl Raw {
    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    fn decoded(&self) -> Vec<u8> {
        let mut decoded = Vec::new();
        GzDecoder::new(&self.bytes[..]).read_to_end(&mut decoded).unwrap();
        decoded
    }
}

async fn ask(server: &TestServer, method: Method, path: &str, fields: &[(&str, &str)]) -> Raw {
    let request = server.client.request(method.clone(), server.url(path)).header("content-type", "application/json");
    let request = fields.iter().fold(request, |request, (name, value)| request.header(*name, *value));
    let request = if method == Method::POST { request.body("{}") } else { request };
    let answer = request.send().await.unwrap();
    let (status, headers) = (answer.status().as_u16(), answer.headers().clone());
    Raw { status, headers, bytes: answer.bytes().await.unwrap().to_vec() }
}

const GZIP: (&str, &str) = ("accept-encoding", "br, gzip;q=0.8");

#[tokio::test]
async fn whole_answers_are_coded_for_those_who_accept_it() {
    let server = TestServer::start(4, instant_solver()).await;
    let get = ["/", "/openapi.json", "/limits", "/metrics", "/examples/forward-drive", "/page/main.js"];
    let all =
        get.map(|path| (Method::GET, path)).into_iter().chain([(Method::POST, "/solve"), (Method::POST, "/validate")]);
    for (method, path) in all {
        let plain = ask(&server, method.clone(), path, &[]).await;
        let coded = ask(&server, method.clone(), path, &[GZIP]).await;
        assert_eq!((plain.status, coded.status), (200, 200), "{path}");
        assert_eq!((plain.header("content-encoding"), coded.header("content-encoding")), ("", "gzip"), "{path}");
        assert_eq!((plain.header("vary"), coded.header("vary")), ("accept-encoding", "accept-encoding"), "{path}");
        assert_eq!(plain.header("content-type"), coded.header("content-type"), "{path}");
        assert_eq!(coded.header("content-length"), coded.bytes.len().to_string(), "{path}");
        assert!(coded.bytes.len() < plain.bytes.len(), "{path}");
        // Counts and times go on.
        if !["/metrics", "/solve"].contains(&path) {
            assert!(coded.decoded() == plain.bytes, "{path}");
            assert_eq!(ask(&server, method, path, &[GZIP]).await.bytes, coded.bytes, "the same each time: {path}");
        }
    }
}

#[tokio::test]
async fn documents_in_gzip_have_weak_tags_and_heads_of_their_own() {
    let server = TestServer::start(4, instant_solver()).await;
    for path in ["/", "/openapi.json", "/limits", "/page/main.js"] {
        let plain = ask(&server, Method::GET, path, &[]).await;
        let coded = ask(&server, Method::GET, path, &[GZIP]).await;
        let (strong, weak) = (plain.header("etag").to_owned(), coded.header("etag").to_owned());
        assert_eq!(weak, format!("W/{strong}"), "{path}");
        let head = ask(&server, Method::HEAD, path, &[GZIP]).await;
        assert!(head.bytes.is_empty());
        for name in ["content-length", "content-encoding", "etag", "vary", "content-type"] {
            assert_eq!(head.header(name), coded.header(name), "{name} of {path}");
        }
        for known in [&strong, &weak] {
            for (fields, tag) in [(vec![GZIP], &weak), (vec![], &strong)] {
                let fields: Vec<_> = fields.into_iter().chain([("if-none-match", known.as_str())]).collect();
                let answer = ask(&server, Method::GET, path, &fields).await;
                assert_eq!((answer.status, answer.bytes.len()), (304, 0), "{path} {known}");
                assert_eq!((answer.header("etag"), answer.header("vary")), (tag.as_str(), "accept-encoding"));
                assert_eq!(answer.header("content-encoding"), "");
            }
        }
    }
}

#[tokio::test]
async fn short_answers_problems_and_streams_stay_as_they_are() {
    let server = TestServer::start(4, instant_solver()).await;
    for (method, path) in [(Method::GET, "/livez"), (Method::GET, "/nothing"), (Method::POST, "/solve/events")] {
        let answer = ask(&server, method, path, &[GZIP]).await;
        assert_eq!((answer.header("content-encoding"), answer.header("vary")), ("", ""), "{path}");
    }
    let events = ask(&server, Method::POST, "/solve", &[GZIP, ("accept", "text/event-stream")]).await;
    assert_eq!((events.header("content-type"), events.header("content-encoding")), ("text/event-stream", ""));
    let (mut sender, mut receiver) = batch(server.address, "accept-encoding: gzip\r\n").await;
    assert!(sender.send("{\"request_id\": \"a\", \"solve\": {}}\n").await);
    let _open = sender.end().await;
    assert!(!receiver.head().await.contains("content-encoding"));
    assert_eq!(receiver.rest().await[1], json!({"end": {"answered": 1, "problems": 0}}));
}
