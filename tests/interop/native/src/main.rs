//! A node that speaks rmw_zenoh's protocol, driven by JSON lines.
//!
//! `native ENDPOINT DOMAIN`: joins the router at ENDPOINT as rmw_zenoh's nodes do (a peer that listens on
//! loopback), subscribes to what a robot base publishes and prints every message as one JSON line.
//! On standard input: `{"do":"drive","vx":0.1,"wz":0.0,"hz":20}`, `{"do":"rest"}`, `{"do":"graph"}`,
//! `{"do":"call","service":"/yahboomd/estop","data":true}` (without `data`: a Trigger). It ends with its input.

use std::{
    io::{self, BufRead, Write},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use hiroz::{
    context::ZContextBuilder,
    node::ZNode,
    qos::{QosDurability, QosHistory, QosProfile, QosReliability},
    Builder, Result,
};
use hiroz_msgs::{
    diagnostic_msgs::DiagnosticArray,
    geometry_msgs::{Twist, Vector3},
    nav_msgs::Odometry,
    sensor_msgs::{BatteryState, JointState},
    std_srvs::{srv, SetBoolRequest, TriggerRequest},
    tf2_msgs::TFMessage,
};
use serde_json::{json, Value};

const CALL_TIMEOUT: Duration = Duration::from_secs(5);

fn say(line: Value) {
    let mut out = io::stdout().lock();
    // A closed pipe means that the test is over.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

/// Subscribes and prints; the handle keeps the subscription alive.
macro_rules! listen {
    ($node:expr, $type:ty, $topic:literal, $qos:expr) => {
        $node
            .create_sub::<$type>($topic)
            .with_qos($qos)
            .build_with_callback(|message| {
                say(json!({"event": "message", "topic": $topic, "message": message}))
            })?
    };
}

fn call(node: &ZNode, service: &str, data: Option<bool>) -> Result<Value> {
    let runtime = tokio::runtime::Runtime::new()?;
    Ok(match data {
        Some(data) => {
            let client = node.create_client::<srv::SetBool>(service).build()?;
            let request = SetBoolRequest { data };
            let reply = runtime.block_on(client.call_with_timeout(&request, CALL_TIMEOUT))?;
            json!({"success": reply.success, "message": reply.message})
        }
        None => {
            let client = node.create_client::<srv::Trigger>(service).build()?;
            let request = TriggerRequest::default();
            let reply = runtime.block_on(client.call_with_timeout(&request, CALL_TIMEOUT))?;
            json!({"success": reply.success, "message": reply.message})
        }
    })
}

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let (Some(endpoint), Some(domain)) = (args.next(), args.next()) else {
        return Err("usage: native ENDPOINT DOMAIN".into());
    };
    let context = ZContextBuilder::default()
        .with_router_endpoint(endpoint)?
        .with_domain_id(domain.parse()?)
        .build()?;
    let node = context.create_node("native_peer").build()?;

    let reliable = QosProfile {
        reliability: QosReliability::Reliable,
        history: QosHistory::from_depth(10),
        ..Default::default()
    };
    let best_effort = QosProfile {
        reliability: QosReliability::BestEffort,
        ..reliable
    };
    let latched = QosProfile {
        durability: QosDurability::TransientLocal,
        ..reliable
    };
    let _odom = listen!(node, Odometry, "/odom", reliable);
    let _tf = listen!(node, TFMessage, "/tf", reliable);
    let _tf_static = listen!(node, TFMessage, "/tf_static", latched);
    let _joints = listen!(node, JointState, "/joint_states", best_effort);
    let _battery = listen!(node, BatteryState, "/battery_state", best_effort);
    let _diagnostics = listen!(node, DiagnosticArray, "/diagnostics", reliable);

    let cmd_vel = node
        .create_pub::<Twist>("/cmd_vel")
        .with_qos(reliable)
        .build()?;
    let wish: Arc<Mutex<Option<(Twist, Duration)>>> = Arc::default();
    let driving = wish.clone();
    thread::spawn(move || {
        let mut next = Instant::now();
        loop {
            let wanted = driving.lock().unwrap().clone();
            let period = wanted.as_ref().map_or(Duration::from_millis(10), |w| w.1);
            if let Some((twist, _)) = wanted {
                if let Err(error) = cmd_vel.publish(&twist) {
                    say(json!({"event": "error", "message": error.to_string()}));
                }
            }
            next = (next + period).max(Instant::now());
            thread::sleep(next - Instant::now());
        }
    });

    say(json!({"event": "ready", "node": node.name()}));
    for line in io::stdin().lock().lines() {
        let order: Value = serde_json::from_str(&line?)?;
        let number = |name: &str| order[name].as_f64().unwrap_or(0.0);
        match order["do"].as_str().unwrap_or_default() {
            "drive" => {
                let twist = Twist {
                    linear: Vector3 {
                        x: number("vx"),
                        y: number("vy"),
                        z: 0.0,
                    },
                    angular: Vector3 {
                        x: 0.0,
                        y: 0.0,
                        z: number("wz"),
                    },
                };
                let period = Duration::from_secs_f64(1.0 / number("hz").max(1.0));
                *wish.lock().unwrap() = Some((twist, period));
            }
            "rest" => *wish.lock().unwrap() = None,
            "call" => {
                let service = order["service"].as_str().unwrap_or_default();
                match call(&node, service, order["data"].as_bool()) {
                    Ok(reply) => say(json!({"event": "reply", "service": service, "reply": reply})),
                    Err(error) => say(
                        json!({"event": "no_reply", "service": service, "why": error.to_string()}),
                    ),
                }
            }
            "graph" => {
                let graph = context.graph().snapshot(context.domain_id());
                say(json!({"event": "graph", "graph": graph}));
            }
            other => say(json!({"event": "error", "message": format!("unknown order: {other}")})),
        }
    }
    Ok(())
}
