//! Sees to it that bodies come and answers are taken, in bounded memory and in their time.
//!
//! An answer is kept until its last byte is taken, and a client that takes none would keep it for ever. A limit on the time of a
//! write alone would not do: an HTTP/2 client that opens no window has nothing written to it, and one that takes a byte now
//! and then never stalls.

use crate::app::App;
use crate::ledger::{Ledger, Loan};
use crate::observe::Caller;
use crate::place::Work;
use crate::problem::Problem;
use axum::body::{Body, HttpBody};
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use bytes::Bytes;
use http_body::{Frame, SizeHint};
use http_body_util::BodyExt;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

/// Bytes a second that a client must take of a long answer.
const LEAST_RATE: u64 = 64 << 10;

/// What a body counts at least: the request that it belongs to takes room too.
const LEAST_BODY_BYTES: u64 = 64 << 10;

/// Bytes that are lent until the connection lets go of them.
struct Lent {
    bytes: Bytes,
    _loan: Loan,
    _work: Arc<Work>,
}

impl AsRef<[u8]> for Lent {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// To whom answers are lent, and how long one byte of them may take.
struct Borrower {
    ledger: Arc<Ledger>,
    work: Arc<Work>,
    stall: Duration,
}

impl Borrower {
    fn lend(&self, counted: u64, all: u64) -> Option<Loan> {
        let within = self.stall + Duration::from_secs(all / LEAST_RATE);
        self.ledger.lend(counted, self.work.cut(), within)
    }
}

pub(crate) async fn pace(
    State(app): State<Arc<App>>,
    request: Request<Body>,
    next: Next,
) -> Result<Response, Problem> {
    let Some(Caller { work, .. }) = request.extensions().get::<Caller>().cloned() else {
        return Err(Problem::internal("the request came by no connection"));
    };
    let limits = app.options.limits;
    let announced = request.body().size_hint().exact().unwrap_or(limits.body_bytes as u64);
    let body = (announced > 0).then(|| {
        // More than a body's limit is refused before it comes.
        let counted = announced.min(limits.body_bytes as u64).max(LEAST_BODY_BYTES);
        app.bodies.lend(counted, work.cut(), limits.request_time)
    });
    if matches!(body, Some(None)) {
        return Err(Problem::busy("too many bodies are under way"));
    }
    let (head, answer) = next.run(request).await.into_parts();
    drop(body);
    let borrower = Borrower { ledger: Arc::clone(&app.answers), work, stall: limits.stall_time };
    let answer = match answer.size_hint().exact() {
        Some(0) => answer,
        Some(length) => {
            let full = || Problem::busy("answers that were not taken yet fill the room for them");
            let loan = borrower.lend(length, length).ok_or_else(full)?;
            // It is there already: its length is known.
            let whole = answer.collect().await;
            let whole = whole.map_err(|_| Problem::internal("the answer was cut off"))?;
            Body::from(Bytes::from_owner(Lent {
                bytes: whole.to_bytes(),
                _loan: loan,
                _work: borrower.work,
            }))
        }
        None => {
            let awaited = borrower.lend(0, 0);
            Body::new(Stream { body: answer, borrower, awaited })
        }
    };
    Ok(Response::from_parts(head, answer))
}

/// A stream, made as it is taken: streams are few, and one holds a frame or two, so that their bytes are not counted. Its client
/// owes the next step whenever the server is not at work on one.
struct Stream {
    body: Body,
    borrower: Borrower,
    awaited: Option<Loan>,
}

impl HttpBody for Stream {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let this = &mut *self;
        this.awaited = None;
        let frame = ready!(Pin::new(&mut this.body).poll_frame(context));
        this.awaited = this.borrower.lend(0, 0);
        let lent = |bytes: Bytes| match this.borrower.lend(0, bytes.len() as u64) {
            Some(loan) => Bytes::from_owner(Lent {
                bytes,
                _loan: loan,
                _work: Arc::clone(&this.borrower.work),
            }),
            None => bytes,
        };
        Poll::Ready(frame.map(|frame| frame.map(|frame| frame.map_data(lent))))
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
