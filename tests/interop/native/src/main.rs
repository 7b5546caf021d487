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
    attachment::Attachment,
    context::ZContextBuilder,
    msg::{ZDeserializer, ZMessage},
    node::ZNode,
    qos::{QosDurability, QosHistory, QosProfile, QosReliability},
    Builder, Result, WithTypeInfo,
};
use hiroz_msgs::{
    diagnostic_msgs::DiagnosticArray,
    geometry_msgs::{Twist, Vector3},
    nav_msgs::Odometry,
    sensor_msgs::{BatteryState, JointState},
    std_srvs::{srv, SetBoolRequest, TriggerRequest},
    tf2_msgs::TFMessage,
};
use serde::Serialize;
use serde_json::{json, Value};
use zenoh::sample::Sample;

const CALL_TIMEOUT: Duration = Duration::from_secs(5);

fn say(line: Value) {
    let mut out = io::stdout().lock();
    // A closed pipe means that the test is over.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

/// What rmw_zenoh reads of an attachment. It ends the process when it cannot; here it is said.
fn attached(sample: &Sample) -> Result<Value> {
    let bytes = sample.attachment().ok_or("no attachment")?;
    let attachment = Attachment::try_from(bytes)?;
    Ok(json!({
        "sequence": attachment.sequence_number,
        "stamp_ns": attachment.source_timestamp,
        "gid": attachment.source_gid,
        "bytes": bytes.len(),
    }))
}

/// Subscribes, and prints what comes from a thread of its own.
fn listen<T>(node: &ZNode, topic: &'static str, qos: QosProfile) -> Result<()>
where
    T: ZMessage + WithTypeInfo + Serialize,
    T::Serdes: for<'a> ZDeserializer<Output = T, Input<'a> = &'a [u8]> + Send,
{
    let subscriber = node.create_sub::<T>(topic).with_qos(qos).build()?;
    thread::spawn(move || {
        while let Ok(sample) = subscriber.recv_serialized() {
            let message = T::deserialize(&sample.payload().to_bytes());
            match (message, attached(&sample)) {
                (Ok(message), Ok(attachment)) => say(json!({
                    "event": "message", "topic": topic, "message": message, "attachment": attachment,
                })),
                (Err(error), _) => {
                    say(json!({"event": "error", "topic": topic, "message": error.to_string()}))
                }
                (_, Err(error)) => {
                    say(json!({"event": "error", "topic": topic, "message": error.to_string()}))
                }
            }
        }
    });
    Ok(())
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
        history: QosHistory::from_depth(1000), // what is printed late is not lost
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
    listen::<Odometry>(&node, "/odom", reliable)?;
    listen::<TFMessage>(&node, "/tf", reliable)?;
    listen::<TFMessage>(&node, "/tf_static", latched)?;
    listen::<JointState>(&node, "/joint_states", best_effort)?;
    listen::<BatteryState>(&node, "/battery_state", best_effort)?;
    listen::<DiagnosticArray>(&node, "/diagnostics", reliable)?;

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
