//! `docs/openapi.json` is the contract that the daemon serves.
//!
//! ```text
//!                        ┌─► web/contract.mjs ─► web/src/contract.ts, which the page imports
//! docs/openapi.json ─────┤
//!     ▲ equal            └─► clients/python/tests/test_models.py, which compares the models
//! GET /openapi.json
//! ```
//!
//! A client that does not follow a change of the API therefore fails its own checks, without a daemon.

use crate::rig::Rig;
use std::path::Path;

const REFRESH: &str = "CARVED_UPDATE_OPENAPI=1 cargo test --test http openapi_file";

#[test]
fn the_committed_contract_is_the_served_one() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/openapi.json");
    let rig = Rig::start();
    let mut served = serde_json::to_string_pretty(rig.contract()).unwrap();
    served.push('\n');
    if std::env::var_os("CARVED_UPDATE_OPENAPI").is_some_and(|value| value == "1") {
        std::fs::write(&file, served).unwrap();
        return;
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_else(|why| panic!("{}: {why}. Write it: {REFRESH}", file.display()));
    let equal = committed.lines().zip(served.lines()).take_while(|(committed, served)| committed == served).count();
    let line = |text: &str| text.lines().nth(equal).unwrap_or("(the end)").trim().to_owned();
    assert!(
        committed == served,
        "docs/openapi.json differs from the served contract in line {}.\ncommitted: {}\nserved: {}\nRefresh it: {REFRESH}\n\
         Then let the clients follow: (cd web && npm run contract && npm run check); clients/python/check test tests/test_models.py",
        equal + 1,
        line(&committed),
        line(&served)
    );
}
