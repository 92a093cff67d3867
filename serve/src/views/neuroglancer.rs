//! Neuroglancer's state for a dataset, as a link.

use serde_json::json;
use std::fmt::Write;

/// The public build of Neuroglancer; it fetches from the server, wherever that is.
const VIEWER: &str = "https://neuroglancer-demo.appspot.com/#!";

/// A link that opens a dataset, served at `base` (as in `http://127.0.0.1:8642`), in Neuroglancer. Its samples in `range`, as
/// precomputed has them, are shown from black to white: Neuroglancer itself would take the type's whole range.
pub fn neuroglancer_link(base: &str, dataset: &str, range: [f64; 2]) -> String {
    let source = format!("{base}/precomputed/{}/|neuroglancer-precomputed:", escaped(dataset));
    let controls = json!({"normalized": {"range": range}});
    let layer =
        json!({"type": "image", "source": source, "name": dataset, "shaderControls": controls});
    let state = json!({
        "layers": [layer],
        "selectedLayer": {"visible": true, "layer": dataset},
        "layout": "4panel",
    });
    VIEWER.to_owned() + &escaped(&state.to_string())
}

/// A text as part of an address.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte) {
            escaped.push(char::from(byte));
        } else {
            let _ = write!(escaped, "%{byte:02X}");
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_an_address_would_take_apart_is_escaped_in_the_source_and_whole_as_the_label() {
        let link = neuroglancer_link("http://a:1", "50% of|a #b?", [0.0, 1.0]);
        let state = link.strip_prefix(VIEWER).unwrap();
        let mut bytes = state.bytes();
        let mut plain = Vec::new();
        while let Some(byte) = bytes.next() {
            let mut digit = || char::from(bytes.next().unwrap()).to_digit(16).unwrap() as u8;
            plain.push(if byte == b'%' { 16 * digit() + digit() } else { byte });
        }
        let state: serde_json::Value = serde_json::from_slice(&plain).unwrap();
        let layer = &state["layers"][0];
        let source = "http://a:1/precomputed/50%25%20of%7Ca%20%23b%3F/|neuroglancer-precomputed:";
        assert_eq!((&layer["source"], &layer["name"]), (&json!(source), &json!("50% of|a #b?")));
    }
}
