/* Reads and drives a robot: ./robot square. It needs zenoh-pico and jansson.
 * The contract of its commands and exit codes is in examples/clients/README.md. */
#include "robot.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *usage =
    "usage: robot pose | status | estop | release | set-pose X Y THETA | config\n"
    "             | square [SIDE] | moves [SIDE] | decode PoseSample|StatusSample|ServiceReply\n";

const char *endpoint(void) {
    const char *robot = getenv("ROBOT");
    return robot != NULL && *robot != '\0' ? robot : "tcp/127.0.0.1:7448";
}

const char *full_key(const char *name, char key[256]) {
    const char *namespace = getenv("NAMESPACE");
    bool given = namespace != NULL && *namespace != '\0';
    snprintf(key, 256, "%s%s%s", given ? namespace : "", given ? "/" : "", name);
    return key;
}

static void show(json_t *message) {
    json_dumpf(message, stdout, JSON_COMPACT);
    putchar('\n');
}

json_t *query(const z_loaned_session_t *session, const char *key_name, const char *payload,
              const char *name, bool *is_sample) {
    char key[256];
    z_view_keyexpr_t expression;
    z_view_keyexpr_from_str(&expression, full_key(key_name, key));
    z_get_options_t options;
    z_get_options_default(&options);
    options.timeout_ms = 5000;
    /* An e-stop must reach every daemon, even where another client declares that key. */
    options.target = Z_QUERY_TARGET_ALL;
    z_owned_bytes_t bytes;
    if (payload != NULL && z_bytes_copy_from_str(&bytes, payload) == Z_OK)
        options.payload = z_move(bytes);
    z_owned_closure_reply_t closure;
    z_owned_fifo_handler_reply_t replies;
    z_fifo_channel_reply_new(&closure, &replies, 8);
    json_t *answer = NULL;
    z_owned_reply_t reply;
    if (z_get(session, z_loan(expression), "", z_move(closure), &options) == Z_OK)
        while (answer == NULL && z_recv(z_loan(replies), &reply) == Z_OK) {
            if (z_reply_is_ok(z_loan(reply))) {
                const z_loaned_sample_t *sample = z_reply_ok(z_loan(reply));
                answer = read_sample(name, sample);
                *is_sample = answer != NULL;
                if (answer == NULL) answer = read_sample("ServiceReply", sample);
            }
            z_drop(z_move(reply));
        }
    z_drop(z_move(replies));
    return answer;
}

json_t *ask(const z_loaned_session_t *session, const char *key_name, const char *payload,
            const char *name, bool *is_sample) {
    json_t *answer = query(session, key_name, payload, name, is_sample);
    char key[256];
    if (answer == NULL)
        fprintf(stderr, "Nothing at %s answers %s. Is yahboomd running, with this NAMESPACE?\n",
                endpoint(), full_key(key_name, key));
    return answer;
}

static int run(z_owned_session_t *session, int count, char **words) {
    bool is_sample = false;
    const char *command = words[1], *message = "ServiceReply", *key = "yahboomd/config";
    char payload[128] = "";
    if (strcmp(command, "pose") == 0) {
        message = "PoseSample", key = "yahboomd/pose";
    } else if (strcmp(command, "status") == 0 || strcmp(command, "square") == 0) {
        message = "StatusSample", key = "yahboomd/status";
    } else if (strcmp(command, "estop") == 0) {
        key = "yahboomd/estop"; /* any payload engages it, also none */
    } else if (strcmp(command, "release") == 0) {
        key = "yahboomd/estop/reset";
    } else if (strcmp(command, "set-pose") == 0) {
        key = "yahboomd/odometry/set_pose";
        snprintf(payload, sizeof payload, "{\"x\": %.17g, \"y\": %.17g, \"theta\": %.17g}",
                 atof(words[2]), atof(words[3]), atof(words[4]));
    }
    if (strcmp(command, "moves") == 0)
        return drive_moves(z_loan(*session), count > 2 ? atof(words[2]) : 1.0);
    json_t *answer = ask(z_loan(*session), key, *payload ? payload : NULL, message, &is_sample);
    if (answer == NULL) return NO_DAEMON;
    int code = DONE;
    json_t *success = json_object_get(answer, "success");
    if (!is_sample) { /* no sample yet */
        fprintf(stderr, "%s\n", json_string_value(json_object_get(answer, "message")));
        code = NO_DAEMON;
    } else if (strcmp(command, "square") == 0) {
        code = check_status(answer);
        if (code == DONE) code = drive_square(session, count > 2 ? atof(words[2]) : 1.0);
    } else {
        show(answer);
        code = success != NULL && !json_is_true(success) ? REFUSED : DONE;
    }
    json_decref(answer);
    return code;
}

static int decode(const char *name) {
    static char data[1 << 16];
    json_error_t error;
    json_t *message = read_message(name, data, fread(data, 1, sizeof data, stdin), &error);
    if (message == NULL) {
        fprintf(stderr, "This is no %s: %s\n", name, error.text);
        return WRONG_DATA;
    }
    show(message);
    json_decref(message);
    return DONE;
}

static bool right_words(int count, char **words) {
    static const char *const plain[] = {"pose",   "status", "estop", "release",
                                        "config", "square", "moves"};
    char *end = "";
    for (int i = 2; i < count && *end == '\0'; i++) strtod(words[i], &end);
    if (count < 2 || *end != '\0') return false;
    for (size_t i = 0; i < sizeof plain / sizeof *plain; i++)
        if (strcmp(words[1], plain[i]) == 0) return count == 2 || (i >= 5 && count == 3);
    return strcmp(words[1], "set-pose") == 0 && count == 5;
}

bool open_session(z_owned_session_t *session) {
    z_owned_config_t config;
    z_config_default(&config);
    zp_config_insert(z_loan_mut(config), Z_CONFIG_MODE_KEY, "client");
    zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, endpoint());
    return z_open(session, z_move(config), NULL) == Z_OK;
}

int main(int count, char **words) {
    if (count == 3 && strcmp(words[1], "decode") == 0 &&
        (strcmp(words[2], "PoseSample") == 0 || strcmp(words[2], "StatusSample") == 0 ||
         strcmp(words[2], "ServiceReply") == 0))
        return decode(words[2]);
    if (!right_words(count, words)) {
        fputs(usage, stderr);
        return USAGE;
    }
    z_owned_session_t session;
    if (!open_session(&session)) {
        fprintf(stderr, "No yahboomd answers at %s. Start one with `yahboomd run`, or set ROBOT.\n",
                endpoint());
        return NO_DAEMON;
    }
    int code = run(&session, count, words);
    z_drop(z_move(session));
    return code;
}
