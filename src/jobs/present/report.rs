//! A page about plans that needs nothing beside it: answer and certificate in words, figures, request, how to repeat it.

use std::fmt::Write as _;
use std::io;

use crate::contract::indented;
use crate::contract::message::{Figure, PlanInWords, PresentResponse, PresentedPlan};
use crate::plot::{STYLE, escaped};

const PAGE_STYLE: &str = include_str!("report.css");

/// What a quote has of its length in JSON: indented, with quotes escaped for the page, which is escaped once more.
const QUOTE_FACTOR: usize = 3;
/// The styles and the words around, bytes.
const FRAME_BYTES: usize = 20_000;

/// What the page quotes of a plan: its motion is in the figures.
pub(super) fn quoted(mut plan: PresentedPlan) -> PresentedPlan {
    if let Some(answer) = plan.solve.as_mut().and_then(|solve| solve.answer.as_mut()) {
        (answer.trajectory, answer.contacts) = (None, None);
    }
    if let Some(answer) = plan.simulate.as_mut().and_then(|simulate| simulate.answer.as_mut()) {
        (answer.trajectory, answer.contacts) = (None, None);
    }
    plan
}

/// What the page has beside figures and words that the answer has too, bytes.
pub(super) fn further_bytes(quoted: &[PresentedPlan]) -> usize {
    let mut length = Length(0);
    // Messages are names and numbers, and counting cannot fail.
    let _ = serde_json::to_writer(&mut length, quoted);
    FRAME_BYTES + QUOTE_FACTOR * length.0
}

/// How many bytes were written to it.
struct Length(usize);

impl io::Write for Length {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The page about plans that were asked for, and are presented.
pub(super) fn page(asked: &[PresentedPlan], response: &PresentResponse) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n\
         <style>\n{STYLE}{PAGE_STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{}</h1>\n",
        title(response),
        title(response)
    );
    for words in &response.plans {
        write_words(words, response.plans.len(), &mut page);
    }
    page.push_str("<h2>Figures</h2>\n");
    for figure in &response.figures {
        write_figure(figure, &mut page);
    }
    for (plan, words) in asked.iter().zip(&response.plans) {
        write_repetition(plan, &words.label, asked.len(), &mut page);
    }
    // Writing to a string cannot fail, here and below.
    let _ = write!(page, "<p class=\"foot\">slipdrive {}</p>\n</main>\n</body>\n</html>\n", env!("CARGO_PKG_VERSION"));
    page
}

fn title(response: &PresentResponse) -> &'static str {
    if response.plans.len() > 1 { "Plans of slipdrive" } else { "A plan of slipdrive" }
}

fn write_words(words: &PlanInWords, count: usize, page: &mut String) {
    let label = if count > 1 { format!("{}. ", escaped(&words.label)) } else { String::new() };
    let _ = writeln!(page, "<section>\n<h2>{label}{}</h2>", escaped(&words.headline));
    // Each sentence by itself: the last may be a warning.
    for sentence in &words.details {
        let _ = writeln!(page, "<p>{}</p>", escaped(sentence));
    }
    if !words.certificate.is_empty() {
        page.push_str("<h3>Why to trust it</h3>\n<ul>\n");
        for sentence in &words.certificate {
            let (topic, rest) = sentence.split_once(": ").unwrap_or(("Note", sentence));
            let _ = writeln!(page, "<li><b>{}:</b> {}</li>", escaped(topic), escaped(rest));
        }
        page.push_str("</ul>\n");
    }
    page.push_str("</section>\n");
}

fn write_figure(figure: &Figure, page: &mut String) {
    let Figure { name, caption, svg, .. } = figure;
    let (name, caption) = (escaped(name), escaped(caption));
    // Wide figures scroll by themselves, also by keys.
    let _ = writeln!(
        page,
        "<figure id=\"{name}\">\n<div class=\"scroll\" tabindex=\"0\">{}</div>\n<figcaption>{caption}</figcaption>\n</figure>",
        svg.trim_end()
    );
}

fn write_repetition(plan: &PresentedPlan, label: &str, count: usize, page: &mut String) {
    let (it, of) = match count {
        1 => ("it".to_owned(), String::new()),
        _ => (escaped(label), format!(" {}", escaped(label))),
    };
    let (command, request, answer) = match plan {
        PresentedPlan { solve: Some(solve), .. } => ("solve", indented(&solve.request), indented(&solve.answer)),
        PresentedPlan { simulate, .. } => {
            let simulate = simulate.as_deref();
            let (request, answer) = (simulate.map(|it| &it.request), simulate.map(|it| &it.answer));
            ("simulate", indented(&request), indented(&answer))
        }
    };
    let _ = writeln!(
        page,
        "<section>\n<h2>How to repeat {it}</h2>\n<p>Save the request below as <code>request.json</code>, then</p>\n\
         <pre>slipdrive {command} request.json --report report.html</pre>\n<p>or ask a server:</p>\n\
         <pre>curl -s http://127.0.0.1:8080/{command} -H 'content-type: application/json' -d @request.json</pre>\n\
         <p>The same version on the same platform answers the same, to the last bit, unless a limit of time ended the \
         search.</p>\n<details><summary>Request{of}</summary>\n<pre>{}</pre>\n</details>\n\
         <details><summary>Answer{of}, without its motion</summary>\n<pre>{}</pre>\n</details>\n</section>",
        escaped_lines(&request),
        escaped_lines(&answer)
    );
}

/// Escaped, with its lines.
fn escaped_lines(text: &str) -> String {
    text.lines().map(escaped).collect::<Vec<_>>().join("\n")
}
