//! A page that shows tables and pictures offline.

use std::fmt::Write;
use std::num::NonZeroUsize;

use crate::experiment::{ESTIMATORS, Row, STEPS};
use crate::figures::Figure;

const HEAD: &str = "<!DOCTYPE html>
<html lang=\"en\">
<head>
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">
<title>Visual place recognition in Canberra, reconstructed</title>
<style>
:root { color-scheme: light dark; --ink: #222; --paper: #fff; --soft: #555; --rule: #ddd; --head: #f2f2f2; --link: #0000ee; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --paper: #16181b; --soft: #b4b4b4; --rule: #3a3e43; --head: #24272b; --link: #8ab4f8; }
}
body { font: 16px/1.5 sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink); background: var(--paper); }
a { color: var(--link); }
p, figcaption { max-width: 50rem; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: .25rem .8rem; text-align: right; border-bottom: 1px solid var(--rule); }
th { font-weight: normal; color: var(--soft); }
th:first-child, td:first-child { text-align: left; }
td { white-space: nowrap; }
tbody th { background: var(--head); color: var(--ink); font-weight: bold; }
figure { margin: 2.5rem 0; }
/* Pictures keep a white ground, so that they are readable in dark mode, too. */
img { max-width: 100%; height: auto; border: 1px solid var(--rule); background: #fff; }
figcaption { color: var(--soft); }
@media (max-width: 40rem) {
  h1 { font-size: 1.5rem; }
  table { width: 100%; font-size: .85rem; }
  th, td { padding: .25rem .2rem; }
}
</style>
</head>
<body>
<h1>Visual place recognition in Canberra, reconstructed</h1>
";

pub(crate) fn html(rows: &[Row], figures: &[Figure], runs: NonZeroUsize, seed: u64) -> String {
    let mut page = String::from(HEAD);
    let mut put = |text: std::fmt::Arguments<'_>| {
        page.write_fmt(text).expect("a String takes all that is written");
    };
    put(format_args!(
        "<p>Guo, Zhao and Zhou compare an HMM filter with an HMM smoother that estimate at which of \
         105 intersections a vehicle is. This is a <strong>reconstruction</strong>: the paper's \
         matrices are lost, so the map is taken from the real streets, and the probabilities \
         follow from stated rules. Neither model nor seed was chosen by the accuracies. Each figure \
         of the paper is one drive of {STEPS} steps; here it is {runs} drives (seed \
         {seed}).</p>\n<h2>Table 1</h2>\n<p>A drive starts at place 5 or 90. At each step the \
         sensor names a place, often a wrong one; σ is the standard deviation of the Gaussian part \
         of its errors, in numbers of places. “Sensor alone” takes the place that it names.</p>\n\
         <table>\n<thead><tr>\
         <th></th><th>mean accuracy ± standard error</th><th>95% of drives</th><th>paper</th></tr></thead>\n"
    ));
    for rows in rows.chunks(ESTIMATORS.len()) {
        put(format_args!("{}", setting(&rows[0])));
        for row in rows {
            let paper = row.paper().map_or(String::from("–"), |paper| format!("{paper:.2}"));
            put(format_args!(
                "<tr><td>{}</td><td>{:.4} ± {:.4}</td><td>{:.2} to {:.2}</td><td>{paper}</td></tr>\n",
                row.estimator, row.mean, row.std_error, row.lo95, row.hi95
            ));
        }
    }
    put(format_args!(
        "</tbody>\n</table>\n<h2>Errors, and drives that a car could drive</h2>\n<p>Hops count roads \
         between the true and the estimated place, metres are straight. A drive is legal if each of \
         its moves, starting from the known place, has a probability above 0. The smoother names \
         the best place for each step, and its sequence need not be legal; Viterbi's is by \
         construction.</p>\n\
         <table>\n<thead><tr><th></th><th>hops</th><th>metres</th><th>legal drives</th></tr></thead>\n"
    ));
    for rows in rows.chunks(ESTIMATORS.len()) {
        put(format_args!("{}", setting(&rows[0])));
        for row in rows {
            put(format_args!(
                "<tr><td>{}</td><td>{:.3}</td><td>{:.1}</td><td>{:.1}%</td></tr>\n",
                row.estimator,
                row.hops,
                row.metres,
                100.0 * row.legal
            ));
        }
    }
    put(format_args!(
        "</tbody>\n</table>\n<p>Both tables as CSV: <a href=\"table1.csv\">table1.csv</a>, \
         <a href=\"errors.csv\">errors.csv</a>; the accuracy of each drive: \
         <a href=\"drives.csv\">drives.csv</a>.</p>\n<h2>Pictures</h2>\n\
         <p><a href=\"replay.html\">Replay of the first drives</a>: on the map, step by step, where \
         the vehicle is, what it sees, and what filter and smoother believe.</p>\n"
    ));
    for Figure { file, caption } in figures {
        put(format_args!(
            "<figure><a href=\"{file}\"><img src=\"{file}\" alt=\"{caption}\"></a>\
             <figcaption>{caption}</figcaption></figure>\n"
        ));
    }
    put(format_args!("</body>\n</html>\n"));
    page
}

/// Heading of the rows of a setting.
fn setting(row: &Row) -> String {
    format!(
        "<tbody>\n<tr><th colspan=\"4\">Start at place {}, noise of the sensor σ = {}</th></tr>\n",
        row.setting.initial, row.setting.sigma
    )
}
