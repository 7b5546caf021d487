//! The bridge between Zenoh and ROS 2 over DDS: its plugin, linked into a program of one configuration file.
//!
//! `bridge CONFIG.json5 [ENDPOINT]`: ENDPOINT is listened on instead of the configuration's.

use zenoh::{
    internal::{plugins::PluginsManager, runtime::RuntimeBuilder},
    Config,
};
use zenoh_plugin_ros2dds::ROS2Plugin;

#[tokio::main(flavor = "multi_thread")]
async fn main() -> zenoh::Result<()> {
    zenoh::init_log_from_env_or("warn");
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("usage: bridge CONFIG.json5 [ENDPOINT]")?;
    let mut config = Config::from_file(path)?;
    if let Some(endpoint) = args.next() {
        config.insert_json5("listen/endpoints", &format!("[{endpoint:?}]"))?;
    }

    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<ROS2Plugin, _>("ros2dds", true);
    let mut runtime = RuntimeBuilder::new(config)
        .plugins_manager(plugins)
        .build()
        .await?;
    runtime.start().await?;

    tokio::signal::ctrl_c().await?;
    runtime.close().await
}
