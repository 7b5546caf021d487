//! Reads and drives a robot: `cargo run -- square`.
//! The contract of its commands and exit codes is in examples/clients/README.md.

use std::io::Read;
use std::time::Duration;

use serde::{de::DeserializeOwned, Serialize};
use serde_json::json;
use zenoh::{query::QueryTarget, sample::Sample, Session, Wait};

mod moves;
mod square;

// The types are made of the schemas at compile time; they refuse what the schemas refuse.
mod pose {
    typify::import_types!("../../../schemas/PoseSample.json");
}
mod status {
    typify::import_types!("../../../schemas/StatusSample.json");
}
mod reply {
    typify::import_types!("../../../schemas/ServiceReply.json");
}
mod moved {
    typify::import_types!("../../../schemas/MoveSample.json");
}
use moved::MoveSample;
use pose::PoseSample;
use reply::ServiceReply;
use status::StatusSample;

const USAGE: &str = "usage: robot pose | status | estop | release | set-pose X Y THETA | config
             | square [SIDE] | moves [SIDE] | decode PoseSample|StatusSample|ServiceReply";

/// An exit code (sysexits.h), and what went wrong.
struct Failure(i32, String);
type Outcome<T> = Result<T, Failure>;

fn robot() -> String {
    std::env::var("ROBOT").unwrap_or("tcp/127.0.0.1:7448".into())
}

fn key(name: &str) -> String {
    match std::env::var("NAMESPACE") {
        Ok(namespace) if !namespace.is_empty() => format!("{namespace}/{name}"),
        _ => name.into(),
    }
}

fn read<T: DeserializeOwned>(name: &str, payload: &[u8]) -> Outcome<T> {
    serde_json::from_slice(payload)
        .map_err(|error| Failure(65, format!("This is no {name}: {error}")))
}

fn show(message: &impl Serialize) {
    println!("{}", serde_json::to_string(message).unwrap());
}

fn connect() -> Outcome<Session> {
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"client\"").unwrap();
    let opened = config
        .insert_json5("connect/endpoints", &json!([robot()]).to_string())
        .and_then(|_| zenoh::open(config).wait());
    opened.map_err(|_| {
        let words = "Start one with `yahboomd run`, or set ROBOT.";
        Failure(69, format!("No yahboomd answers at {}. {words}", robot()))
    })
}

/// The answer to a query. ALL: an e-stop must reach every daemon, even where another client
/// declares that key.
fn ask(session: &Session, name: &str, payload: String) -> Outcome<Sample> {
    let replies = session
        .get(key(name))
        .payload(payload)
        .target(QueryTarget::All)
        .timeout(Duration::from_secs(5))
        .wait()
        .map_err(|error| Failure(69, error.to_string()))?;
    while let Ok(reply) = replies.recv() {
        if let Ok(sample) = reply.into_result() {
            return Ok(sample);
        }
    }
    let words = "Is yahboomd running, with this NAMESPACE?";
    Err(Failure(
        69,
        format!("Nothing at {} answers {}. {words}", robot(), key(name)),
    ))
}

fn call(name: &str, payload: String) -> Outcome<()> {
    let reply: ServiceReply = read(
        "ServiceReply",
        &ask(&connect()?, name, payload)?.payload().to_bytes(),
    )?;
    show(&reply);
    if reply.success {
        Ok(())
    } else {
        Err(Failure(1, reply.message))
    }
}

fn newest<T: DeserializeOwned>(session: &Session, name: &str, message: &str) -> Outcome<T> {
    let sample = ask(session, name, String::new())?;
    if sample.encoding().to_string().ends_with(";ServiceReply") {
        let reply: ServiceReply = read("ServiceReply", &sample.payload().to_bytes())?;
        return Err(Failure(69, reply.message)); // no sample yet
    }
    read(message, &sample.payload().to_bytes())
}

fn check(status: &StatusSample) -> Outcome<()> {
    match status.state.as_str() {
        "waiting" | "standing" | "driving" | "stopping" => Ok(()),
        // A state of a later version, too, is one in which the robot may not drive.
        state => Err(Failure(
            75,
            format!("The robot will not move. It is {state}: {}", status.why),
        )),
    }
}

fn decode(message: &str) -> Outcome<()> {
    let mut payload = Vec::new();
    std::io::stdin()
        .read_to_end(&mut payload)
        .map_err(|error| Failure(65, error.to_string()))?;
    match message {
        "PoseSample" => show(&read::<PoseSample>(message, &payload)?),
        "StatusSample" => show(&read::<StatusSample>(message, &payload)?),
        _ => show(&read::<ServiceReply>(message, &payload)?),
    }
    Ok(())
}

fn run(words: &[&str]) -> Outcome<()> {
    let usage = || Failure(64, USAGE.into());
    let number = |word: &&str| word.parse::<f64>().map_err(|_| usage());
    match words {
        ["pose"] => show(&newest::<PoseSample>(
            &connect()?,
            "yahboomd/pose",
            "PoseSample",
        )?),
        ["status"] => show(&newest::<StatusSample>(
            &connect()?,
            "yahboomd/status",
            "StatusSample",
        )?),
        ["estop"] => call("yahboomd/estop", String::new())?, // any payload engages it, also none
        ["release"] => call("yahboomd/estop/reset", String::new())?,
        ["config"] => call("yahboomd/config", String::new())?,
        ["set-pose", x, y, theta] => {
            let pose = json!({"x": number(x)?, "y": number(y)?, "theta": number(theta)?});
            call("yahboomd/odometry/set_pose", pose.to_string())?
        }
        ["moves"] => moves::square(1.0)?,
        ["moves", side] => moves::square(number(side)?)?,
        ["square"] => square::square(1.0)?,
        ["square", side] => square::square(number(side)?)?,
        ["decode", message @ ("PoseSample" | "StatusSample" | "ServiceReply")] => decode(message)?,
        _ => return Err(usage()),
    }
    Ok(())
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let Err(Failure(code, why)) = run(&words.iter().map(String::as_str).collect::<Vec<_>>()) {
        eprintln!("{why}");
        std::process::exit(code);
    }
}
