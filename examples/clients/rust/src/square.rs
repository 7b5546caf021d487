//! Drives to four corners, in a frame that begins where the robot stands.

use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::json;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::{sample::Sample, Wait};

use crate::{check, connect, key, newest, read, robot, show, Failure, Outcome, PoseSample};

const PERIOD: Duration = Duration::from_millis(50);
const STALE: Duration = Duration::from_millis(300); // an older pose does not say where we are
const PATIENCE: Duration = Duration::from_secs(30);

struct Square<'a> {
    commands: Publisher<'a>,
    poses: Subscriber<RingChannelHandler<Sample>>,
    statuses: Subscriber<RingChannelHandler<Sample>>,
    pose: Option<PoseSample>,
    arrived: Instant,
    ended: Arc<AtomicBool>,
    x: f64,
    y: f64,
    theta: f64,
}

impl Square<'_> {
    fn send(&self, vx: f64, wz: f64) {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap()
            .as_nanos() as u64;
        let command = json!({"vx": vx, "wz": wz, "stamp_ns": now, "source": "square"});
        // An error means that the daemon is away: then no pose comes either.
        let _ = self.commands.put(command.to_string()).wait();
    }

    /// Sends one command, or zero where the newest pose is too old; then reads the next pose. There
    /// is no other thread that sends: a loop that stalls sends nothing.
    fn step(&mut self, vx: f64, wz: f64) -> Outcome<()> {
        let silent = self.arrived.elapsed();
        match silent > STALE || self.pose.is_none() {
            true => self.send(0.0, 0.0),
            false => self.send(vx, wz),
        }
        if silent > PATIENCE {
            return Err(Failure(
                75,
                format!("No pose came from {} for 30 s.", robot()),
            ));
        }
        sleep(PERIOD);
        if self.ended.load(Relaxed) {
            return Err(Failure(130, "The square was ended by a signal.".into()));
        }
        if let Ok(Some(sample)) = self.statuses.try_recv() {
            if let Ok(status) = read("StatusSample", &sample.payload().to_bytes()) {
                check(&status)?;
            }
        }
        if let Ok(Some(sample)) = self.poses.try_recv() {
            if let Ok(pose) = read("PoseSample", &sample.payload().to_bytes()) {
                self.follow(pose);
            }
        }
        Ok(())
    }

    /// Adds the step from the last pose to this one.
    fn follow(&mut self, new: PoseSample) {
        self.arrived = Instant::now();
        if let Some(old) = &self.pose {
            let (dx, dy, turned) = (new.x - old.x, new.y - old.y, new.theta - old.theta);
            let restarted = new.seq <= old.seq;
            let was_set = dx.hypot(dy) > 0.5 || turned.abs() > 0.5;
            if !restarted && !was_set {
                let (sin, cos) = (self.theta - old.theta).sin_cos();
                self.x += cos * dx - sin * dy;
                self.y += sin * dx + cos * dy;
                self.theta += turned;
            }
        }
        self.pose = Some(new);
    }

    fn turn_to(&mut self, theta: f64) -> Outcome<()> {
        loop {
            let error = wrap(theta - self.theta);
            if error.abs() < 0.02 {
                return Ok(());
            }
            self.step(0.0, (0.2 + 3.0 * error.abs()).min(1.2).copysign(error))?;
        }
    }

    fn drive_to(&mut self, x: f64, y: f64) -> Outcome<()> {
        self.turn_to((y - self.y).atan2(x - self.x))?;
        loop {
            let (distance, bearing) = (
                (x - self.x).hypot(y - self.y),
                (y - self.y).atan2(x - self.x),
            );
            let error = wrap(bearing - self.theta);
            if distance < 0.01 || error.abs() > 1.0 {
                return Ok(()); // there, or past it
            }
            self.step(
                (0.05 + 2.5 * distance).min(0.25),
                (2.0 * error).clamp(-1.0, 1.0),
            )?;
        }
    }

    fn drive(&mut self, side: f64) -> Outcome<()> {
        for (x, y) in [(side, 0.0), (side, side), (0.0, side), (0.0, 0.0)] {
            println!("driving to {x:.2}, {y:.2}");
            self.drive_to(x, y)?;
        }
        self.turn_to(0.0)
    }
}

fn wrap(angle: f64) -> f64 {
    (angle + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0
}

pub fn square(side: f64) -> Outcome<()> {
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, ended.clone()).unwrap();
    }
    let session = connect()?;
    check(&newest(&session, "yahboomd/status", "StatusSample")?)?;
    // A ring of one holds the newest sample, however slow the loop is.
    let subscribe = |name| {
        session
            .declare_subscriber(key(name))
            .with(RingChannel::new(1))
            .wait()
    };
    let declared = |error: zenoh::Error| Failure(69, error.to_string());
    let mut square = Square {
        commands: session
            .declare_publisher(key("cmd_vel"))
            .wait()
            .map_err(declared)?,
        poses: subscribe("yahboomd/pose").map_err(declared)?,
        statuses: subscribe("yahboomd/status").map_err(declared)?,
        pose: None,
        arrived: Instant::now(),
        ended,
        x: 0.0,
        y: 0.0,
        theta: 0.0,
    };
    let outcome = square.drive(side);
    square.send(0.0, 0.0); // however it ended
    outcome?;
    show(&json!({"x": square.x, "y": square.y, "theta": square.theta}));
    Ok(())
}
