#include <stdio.h>
#include <stdlib.h>
#include <zenoh-pico.h>

static void show(z_loaned_sample_t *sample, void *context) {
    (void)context;
    z_owned_string_t text;
    z_bytes_to_string(z_sample_payload(sample), &text);
    printf("%.*s\n", (int)z_string_len(z_loan(text)), z_string_data(z_loan(text)));
    z_drop(z_move(text));
}

static void drive(const z_loaned_session_t *session, const char *command) {
    z_view_keyexpr_t key;
    z_view_keyexpr_from_str(&key, "cmd_vel");
    z_owned_bytes_t payload;
    z_bytes_copy_from_str(&payload, command);
    z_put(session, z_loan(key), z_move(payload), NULL);
}

int main(void) {
    const char *robot = getenv("ROBOT");
    z_owned_config_t config;
    z_config_default(&config);
    zp_config_insert(z_loan_mut(config), Z_CONFIG_MODE_KEY, "client");
    zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, robot ? robot : "tcp/127.0.0.1:7448");
    z_owned_session_t session;
    if (z_open(&session, z_move(config), NULL) != Z_OK) return 69;
    z_view_keyexpr_t key;
    z_view_keyexpr_from_str(&key, "yahboomd/pose");
    z_owned_closure_sample_t closure;
    z_closure(&closure, show, NULL, NULL);
    z_owned_subscriber_t poses;
    z_declare_subscriber(z_loan(session), &poses, z_loan(key), z_move(closure), NULL);
    for (int i = 0; i < 40; i++) { /* 2 s: a command lapses after 0.5 s, so repeat it */
        drive(z_loan(session), "{\"vx\": 0.2, \"wz\": 0.5}");
        z_sleep_ms(50);
    }
    drive(z_loan(session), "{\"vx\": 0, \"wz\": 0}");
    z_drop(z_move(poses));
    z_drop(z_move(session));
    return 0;
}
