//! Neuroglancer's state for a dataset, as a link.

use serde_json::json;
use std::fmt::Write;

/// The public build of Neuroglancer; it fetches from the server, wherever that is.
const VIEWER: &str = "https://neuroglancer-demo.appspot.com/#!";

/// A link that opens a dataset, served at `base` (as in `http://127.0.0.1:8642`), in Neuroglancer. Its samples in `range`, as
/// precomputed has them, are shown from black to white: Neuroglancer itself would take the type's whole range.
pub fn neuroglancer_link(base: &str, dataset: &str, range: [f64; 2]) -> String {
    let source = format!("{base}/precomputed/{dataset}/|neuroglancer-precomputed:");
    let controls = json!({"normalized": {"range": range}});
    let layer =
        json!({"type": "image", "source": source, "name": dataset, "shaderControls": controls});
    let state = json!({
        "layers": [layer],
        "selectedLayer": {"visible": true, "layer": dataset},
        "layout": "4panel",
    });
    let mut link = VIEWER.to_owned();
    for byte in state.to_string().bytes() {
        if byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte) {
            link.push(char::from(byte));
        } else {
            let _ = write!(link, "%{byte:02X}");
        }
    }
    link
}
