use std::{env, thread::sleep, time::Duration};
use zenoh::{Config, Wait};

fn main() -> zenoh::Result<()> {
    let robot = env::var("ROBOT").unwrap_or("tcp/127.0.0.1:7448".into());
    let mut config = Config::default();
    config.insert_json5("mode", "\"client\"")?;
    config.insert_json5("connect/endpoints", &format!("[\"{robot}\"]"))?;
    let session = zenoh::open(config).wait()?;
    let _poses = session
        .declare_subscriber("yahboomd/pose")
        .callback(|sample| println!("{}", sample.payload().try_to_string().unwrap_or_default()))
        .wait()?;
    for _ in 0..40 {
        // 2 s: a command lapses after 0.5 s, so repeat it
        session.put("cmd_vel", r#"{"vx": 0.2, "wz": 0.5}"#).wait()?;
        sleep(Duration::from_millis(50));
    }
    session.put("cmd_vel", r#"{"vx": 0, "wz": 0}"#).wait()?;
    session.close().wait()
}
