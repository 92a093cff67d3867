//! Who is let in.

use crate::support::{Running, folder, options};
use serve::{Options, Server, Token};

const BRICK: &str = "/v1/v/bricks/0/1/0/0";
const TOKEN: &str = "correct-horse-battery-staple";

#[test]
fn an_address_open_to_others_demands_a_token_or_a_clear_word() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let open = Options { bind: ([0, 0, 0, 0], 0).into(), ..Options::new(Vec::new()) };
    let bind = |options| runtime.block_on(Server::bind(options, None));
    let error = bind(open.clone()).unwrap_err();
    assert!(error.to_string().contains("--insecure-no-token"), "{error}");
    assert!(bind(Options { insecure_no_token: true, ..open.clone() }).is_ok());
    assert!(bind(Options { token: Some(Token::new(TOKEN).unwrap()), ..open }).is_ok());
    assert!(Token::new("short").is_err() && Token::new("has a space in the middle").is_err());
    assert!(!format!("{:?}", Token::new(TOKEN)).contains(TOKEN), "a token is not printed");
}

#[test]
fn a_token_opens_everything_and_without_it_only_health_is_told() {
    let folder = folder();
    let token = Some(Token::new(&format!("{TOKEN}\n")).unwrap());
    let server = Running::new(Options { token, ..options(folder.path()) });
    for path in
        [BRICK, "/", "/v1/datasets", "/metrics", "/openapi.json", "/nothing", "/zarr2/v/.zattrs"]
    {
        let reply = server.get(path);
        reply.assert_problem(401);
        assert!(reply.header("www-authenticate").starts_with("Bearer"));
    }
    assert_eq!((server.get("/healthz").status, server.get("/readyz").status), (200, 200));
    let bearer = format!("Bearer {TOKEN}");
    let cookie = format!("a=b; octavo_token={TOKEN}; c=d");
    for header in [("authorization", bearer.as_str()), ("cookie", cookie.as_str())] {
        let reply = server.get_with(BRICK, &[header]);
        assert_eq!(reply.status, 200);
        assert!(reply.header("cache-control").starts_with("private"));
    }
    for wrong in [
        "Bearer ",
        "Bearer correct-horse-battery-stapl",
        "Basic x",
        &format!("Sealed {TOKEN}"),
        "Bearer correct-horse-battery-staple2",
        TOKEN,
    ] {
        assert_eq!(server.get_with(BRICK, &[("authorization", wrong)]).status, 401, "{wrong}");
    }
    let login = server.get(&format!("/?token={TOKEN}"));
    assert_eq!((login.status, login.header("location")), (303, "/"));
    let set = login.header("set-cookie");
    assert!(set.contains("HttpOnly") && set.contains("SameSite=Strict"), "{set}");
    assert_eq!(server.get("/?token=wrong").status, 401);
    assert_eq!(server.get(&format!("{BRICK}?token={TOKEN}")).status, 401);
    // Browsers ask without it whether they may ask with it.
    let preflight = [("origin", "https://a.example"), ("access-control-request-method", "GET")];
    assert_eq!(server.send("OPTIONS", BRICK, &preflight, None).status, 200);
}
