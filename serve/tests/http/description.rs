//! The OpenAPI document against the routes that there are, and against what they answer.

use crate::support::{Running, Volume, noise};
use octree_store::Encoding;
use std::collections::BTreeSet;

/// Routes as the source states them: path and method.
fn routes() -> BTreeSet<(String, String)> {
    let source = include_str!("../../src/routes/mod.rs");
    let lines = source.lines().filter_map(|line| line.trim().strip_prefix(".route(\""));
    lines
        .map(|line| {
            let (path, rest) = line.split_once("\", ").unwrap();
            let (method, _) = rest.split_once('(').unwrap();
            (path.replace("{*path}", "{path}"), method.to_owned())
        })
        .collect()
}

#[test]
fn the_description_has_every_route_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let server = Running::over(folder.path());
    let document = server.get("/openapi.json").json();
    let described: BTreeSet<(String, String)> = document["paths"]
        .as_object()
        .unwrap()
        .iter()
        .flat_map(|(path, methods)| {
            methods.as_object().unwrap().keys().map(|method| (path.clone(), method.clone()))
        })
        .collect();
    assert_eq!(described, routes());
    assert!(described.len() >= 18);
}

#[test]
fn what_is_answered_has_the_type_and_the_status_that_were_described() {
    let folder = tempfile::tempdir().unwrap();
    let volume = Volume::<u16>::new([20, 9, 9], 8, noise);
    volume.write(&folder.path().join("v.octavo"), Encoding::Lossless);
    let server = Running::over(folder.path());
    let document = server.get("/openapi.json").json();
    for (path, methods) in document["paths"].as_object().unwrap() {
        let concrete = path
            .replace("{dataset}", "v")
            .replace("{file}", "app.js")
            .replace("{level}/{x}/{y}/{z}", "0/1/0/0")
            .replace("{axis}/{index}", "z/3");
        let part = match path.split('/').nth(1).unwrap() {
            "zarr2" => "0/0/0/0",
            "zarr2-5d" => "0/0/0/0/0/0",
            "zarr3" => "0/c/0/0/0",
            "zarr3-5d" => "0/c/0/0/0/0/0",
            "zarr2-codes" => "0/codes/0/0/0",
            "zarr3-codes" => "0/map/c/0/0/0/0",
            _ => "0/0-8_0-8_0-8",
        };
        let mut concrete = concrete.replace("{path}", part);
        if path.ends_with("nodes") {
            concrete += "?level=0";
        }
        for (method, described) in methods.as_object().unwrap() {
            let camera = r#"{"projection":"orthographic","position":[1,1,-9],"target":[1,1,1],"up":[0,-1,0],"height":9}"#;
            let transfer = r#"{"points":[{"value":0,"color":[0,0,0],"extinction":1}]}"#;
            let body = match path.rsplit('/').next().unwrap() {
                "cut" => format!(r#"{{"cameras":[{camera}],"size":[9,9]}}"#),
                "render" => format!(r#"{{"camera":{camera},"size":[9,9],"transfer":{transfer}}}"#),
                _ => r#"{"keys":[[0,0,0,0]]}"#.to_owned(),
            };
            let reply = if method == "post" {
                server.post(&concrete, &body)
            } else {
                server.get(&concrete)
            };
            let status = if path.ends_with("render") { 501 } else { 200 };
            assert_eq!(reply.status, status, "{concrete} {}", String::from_utf8_lossy(&reply.body));
            let answer = &described["responses"][status.to_string()];
            assert!(answer.is_object(), "{path} describes no {status}");
            if let Some(types) = answer["content"].as_object() {
                let found = reply.header("content-type").split(';').next().unwrap();
                assert!(types.contains_key(found), "{path}: {found}");
            }
        }
    }
}
