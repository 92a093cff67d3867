//! The checked pictures as one page without scripts: a table, and every picture beside its reference and their difference.

use super::Checked;
use std::fmt::Write;

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:72rem;padding:0 1rem;\
color:#1a1a1a;background:#fff}table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
td,th{padding:.2rem .8rem;text-align:right;border-bottom:1px solid #8884}td:first-child,th:first-child,\
td:nth-child(2),th:nth-child(2){text-align:left}.no{color:#b00020;font-weight:600}\
figure{margin:1.5rem 0}figure img{width:32.6%;image-rendering:pixelated}figcaption{color:#666}\
@media(prefers-color-scheme:dark){body{background:#16181c;color:#e6e6e6}.no{color:#ff7b88}figcaption{color:#aaa}}";

/// The page. `picture` gives the address of one of the three pictures of a check: 0 the store's, 1 the source's, 2 their difference.
pub fn page(
    title: &str,
    min_psnr_db: f64,
    checked: &[Checked],
    picture: impl Fn(&Checked, usize) -> String,
) -> String {
    let mut html = String::new();
    let title = escaped(title);
    let failed = checked.iter().filter(|c| !c.ok).count();
    let verdict = if failed == 0 {
        format!("All {} pictures reach {min_psnr_db} dB.", checked.len())
    } else {
        format!("{failed} of {} pictures are below {min_psnr_db} dB.", checked.len())
    };
    // Writing to a string cannot fail.
    let _ = write!(
        html,
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{title}</title><style>{STYLE}</style><h1>{title}</h1><p>{verdict}</p>\
         <table><tr><th>view<th>look<th>PSNR dB<th>SSIM<th>largest<th>mean delta E<th>bricks</tr>"
    );
    for check in checked {
        let class = if check.ok { "" } else { " class=\"no\"" };
        let psnr = check.comparison.psnr_db.map_or("the same".to_owned(), |db| format!("{db:.1}"));
        let _ = write!(
            html,
            "<tr{class}><td>{}<td>{}<td>{psnr}<td>{:.5}<td>{:.4}<td>{:.3}<td>{}</tr>",
            check.view,
            check.look,
            check.comparison.ssim,
            check.comparison.max_abs_diff,
            check.comparison.mean_delta_e,
            check.bricks_in_cut
        );
    }
    html.push_str("</table>");
    for check in checked {
        html.push_str("<figure>");
        for (which, what) in
            ["the store's", "the source's", "16 times the difference"].iter().enumerate()
        {
            let _ = write!(
                html,
                "<img src=\"{}\" alt=\"{} {}, {what}\" loading=\"lazy\"> ",
                escaped(&picture(check, which)),
                check.view,
                check.look
            );
        }
        let _ = write!(
            html,
            "<figcaption>{}, {}: the store's picture, the source's, and 16 times their difference</figcaption></figure>",
            check.view, check.look
        );
    }
    html.push_str("</html>\n");
    html
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
