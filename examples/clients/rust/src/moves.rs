//! Drives a square by moves: `yahboomd moves` closes the loop, and this program stays there.

use std::f64::consts::FRAC_PI_2;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::json;
use zenoh::handlers::RingChannel;
use zenoh::{Session, Wait};

use crate::{ask, connect, key, read, show, Failure, MoveSample, Outcome, ServiceReply};

const BEAT: Duration = Duration::from_millis(100);
const SILENCE: Duration = Duration::from_secs(2); // progress comes ten times a second
const KNOWN: Duration = Duration::from_secs(1);

fn request(session: &Session, name: &str, payload: String) -> Outcome<ServiceReply> {
    // A session that was just opened may not know the service: then a query ends at once.
    let begun = Instant::now();
    loop {
        match ask(session, name, payload.clone()) {
            Ok(answer) => return read("ServiceReply", &answer.payload().to_bytes()),
            Err(_) if begun.elapsed() < KNOWN => sleep(BEAT),
            Err(Failure(code, why)) => {
                let words = "Does `yahboomd moves` run beside yahboomd?";
                return Err(Failure(code, format!("{why} {words}")));
            }
        }
    }
}

pub fn square(side: f64) -> Outcome<()> {
    let ended = Arc::new(AtomicBool::new(false));
    for number in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(number, ended.clone()).unwrap();
    }
    let session = connect()?;
    let failed = |error: zenoh::Error| Failure(69, error.to_string());
    // Its token goes with this program: then the moves end.
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let holder = format!("{}-{}", std::process::id(), now.as_nanos());
    let token = key(&format!("yahboomd/moves/holder/{holder}"));
    let _token = session
        .liveliness()
        .declare_token(token)
        .wait()
        .map_err(failed)?;
    let progress = session
        .declare_subscriber(key("yahboomd/moves"))
        .with(RingChannel::new(1))
        .wait()
        .map_err(failed)?;
    let side = json!({"kind": "straight", "distance_m": side});
    let turn = json!({"kind": "turn", "angle_rad": FRAC_PI_2});
    let moves = [&side, &turn, &side, &turn, &side, &turn, &side, &turn];
    let asked = json!({"moves": moves, "by": "square", "holder": holder});
    let reply = request(&session, "yahboomd/moves/start", asked.to_string())?;
    if !reply.success {
        return Err(Failure(75, reply.message));
    }
    let id = reply.data["id"].as_str().unwrap_or_default().to_string();
    let chosen = json!({"id": id}).to_string();
    let mut heard = Instant::now();
    // One loop reads and sends: one that stalls sends no beat, and the robot stops.
    while heard.elapsed() < SILENCE {
        let _ = session
            .put(key("yahboomd/moves/beat"), chosen.clone())
            .wait();
        sleep(BEAT);
        if ended.load(Relaxed) {
            request(&session, "yahboomd/moves/cancel", chosen)?;
            return Err(Failure(130, "The moves were ended by a signal.".into()));
        }
        let Ok(Some(sample)) = progress.try_recv() else {
            continue;
        };
        let Ok(news) = read::<MoveSample>("MoveSample", &sample.payload().to_bytes()) else {
            continue;
        };
        if news.id != id {
            continue;
        }
        heard = Instant::now();
        println!("{:.0} %, {:.1} s are left", 100.0 * news.done, news.left_s);
        if news.state == "ended" {
            show(&news);
            return match news.reason.as_str() {
                "reached" => Ok(()),
                _ => Err(Failure(75, news.message)),
            };
        }
    }
    Err(Failure(
        69,
        "`yahboomd moves` is gone: the robot stops by itself.".into(),
    ))
}
