//! Serves the stores of the folders and files that it is given, until it is interrupted.
//!
//! `cargo run -p serve --example folder -- FOLDER`

use serve::{Options, Server};

#[tokio::main]
async fn main() -> Result<(), serve::ServeError> {
    let mut options = Options::new(std::env::args_os().skip(1).map(Into::into).collect());
    options.bind.set_port(0);
    let server = Server::bind(options, None).await?;
    println!("http://{}", server.address());
    server.run(std::future::pending()).await;
    Ok(())
}
