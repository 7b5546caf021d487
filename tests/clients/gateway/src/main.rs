//! zenohd with the plugins `remote_api` and `rest` linked in: `gateway -c CONFIG.json5`.

use zenoh::{
    internal::{plugins::PluginsManager, runtime::RuntimeBuilder},
    Config,
};
use zenoh_plugin_remote_api::RemoteApiPlugin;
use zenoh_plugin_rest::RestPlugin;

#[tokio::main(flavor = "multi_thread")]
async fn main() -> zenoh::Result<()> {
    zenoh::init_log_from_env_or("warn");
    let path = std::env::args().nth(2).ok_or("usage: gateway -c CONFIG.json5")?;
    let config = Config::from_file(path)?;

    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<RemoteApiPlugin, _>("remote_api", true);
    plugins.declare_static_plugin::<RestPlugin, _>("rest", true);
    let mut runtime = RuntimeBuilder::new(config)
        .plugins_manager(plugins)
        .build()
        .await?;
    runtime.start().await?;

    tokio::signal::ctrl_c().await?;
    runtime.close().await
}
