/* Drives a square by moves: `yahboomd moves` closes the loop, and this program stays there. */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "robot.h"

enum { BEAT_MS = 100, BEATS_OF_SILENCE = 20 /* progress comes ten times a second */ };
enum { KNOWN_MS = 1000 /* a session that was just opened may not know the service */ };

static volatile sig_atomic_t ended = 0;

static void on_signal(int number) { ended = number; }

static json_t *corners(double side) {
    json_t *moves = json_array();
    for (int i = 0; i < 4; i++) {
        json_array_append_new(
            moves, json_pack("{s:s, s:f}", "kind", "straight", "distance_m", side));
        json_array_append_new(
            moves, json_pack("{s:s, s:f}", "kind", "turn", "angle_rad", acos(0.0)));
    }
    return moves;
}

/* The id of the moves; NULL where they are not driven, and `code` says how this program ends. */
static json_t *begin(const z_loaned_session_t *session, const char *holder, double side,
                     int *code) {
    json_t *request = json_pack("{s:o, s:s, s:s}", "moves", corners(side), "by", "square", "holder",
                                holder);
    char *text = json_dumps(request, JSON_COMPACT);
    bool found;
    json_t *reply = NULL;
    z_clock_t begun = z_clock_now();
    while (reply == NULL && z_clock_elapsed_ms(&begun) < KNOWN_MS) {
        reply = query(session, "yahboomd/moves/start", text, "ServiceReply", &found);
        if (reply == NULL) z_sleep_ms(BEAT_MS);
    }
    free(text);
    json_decref(request);
    *code = WILL_NOT_MOVE;
    json_t *id = NULL;
    if (reply == NULL) {
        fprintf(stderr, "No `yahboomd moves` answers at %s. Start it beside yahboomd.\n",
                endpoint());
        *code = NO_DAEMON;
    } else if (json_is_true(json_object_get(reply, "success"))) {
        id = json_incref(json_object_get(json_object_get(reply, "data"), "id"));
    } else {
        fprintf(stderr, "%s\n", json_string_value(json_object_get(reply, "message")));
    }
    json_decref(reply);
    return id;
}

/* The newest progress of these moves; NULL where none came. */
static json_t *news_of(const char *id, const z_loaned_ring_handler_sample_t *ring) {
    z_owned_sample_t sample;
    if (z_try_recv(ring, &sample) != Z_OK) return NULL;
    z_owned_string_t text;
    z_bytes_to_string(z_sample_payload(z_loan(sample)), &text);
    json_t *news = json_loadb(z_string_data(z_loan(text)), z_string_len(z_loan(text)), 0, NULL);
    z_drop(z_move(text));
    z_drop(z_move(sample));
    const char *named = json_string_value(json_object_get(news, "id"));
    if (named != NULL && strcmp(named, id) == 0) return news;
    json_decref(news);
    return NULL;
}

/* One loop reads and sends: one that stalls sends no beat, and the robot stops. */
static int follow(const z_loaned_session_t *session, const char *chosen, const char *id,
                  const z_loaned_ring_handler_sample_t *ring) {
    char key[256];
    z_view_keyexpr_t beat;
    z_view_keyexpr_from_str(&beat, full_key("yahboomd/moves/beat", key));
    for (int silent = 0; silent < BEATS_OF_SILENCE; silent++) {
        z_owned_bytes_t payload;
        z_bytes_copy_from_str(&payload, chosen);
        z_put(session, z_loan(beat), z_move(payload), NULL);
        z_sleep_ms(BEAT_MS);
        if (ended) {
            bool found;
            json_decref(ask(session, "yahboomd/moves/cancel", chosen, "ServiceReply", &found));
            return 128 + ended;
        }
        json_t *news = news_of(id, ring);
        if (news == NULL) continue;
        silent = 0;
        printf("%.0f %%, %.1f s are left\n",
               100.0 * json_number_value(json_object_get(news, "done")),
               json_number_value(json_object_get(news, "left_s")));
        int code = -1;
        if (strcmp(json_string_value(json_object_get(news, "state")), "ended") == 0) {
            bool is_there = strcmp(json_string_value(json_object_get(news, "reason")), "reached") == 0;
            json_dumpf(news, stdout, JSON_COMPACT);
            putchar('\n');
            if (!is_there)
                fprintf(stderr, "%s\n", json_string_value(json_object_get(news, "message")));
            code = is_there ? DONE : WILL_NOT_MOVE;
        }
        json_decref(news);
        if (code >= 0) return code;
    }
    fputs("`yahboomd moves` is gone: the robot stops by itself.\n", stderr);
    return NO_DAEMON;
}

int drive_moves(const z_loaned_session_t *session, double side) {
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);
    char holder[64], name[128], key[256];
    snprintf(holder, sizeof holder, "%ld-%ld", (long)getpid(), (long)time(NULL));
    snprintf(name, sizeof name, "yahboomd/moves/holder/%s", holder);
    z_view_keyexpr_t expression;
    z_view_keyexpr_from_str(&expression, full_key(name, key));
    /* It goes with this program: then the moves end. */
    z_owned_liveliness_token_t token;
    if (z_liveliness_declare_token(session, &token, z_loan(expression), NULL) != Z_OK)
        return NO_DAEMON;
    z_owned_closure_sample_t closure;
    z_owned_ring_handler_sample_t ring;
    z_owned_subscriber_t progress;
    z_ring_channel_sample_new(&closure, &ring, 1);
    z_view_keyexpr_from_str(&expression, full_key("yahboomd/moves", key));
    if (z_declare_subscriber(session, &progress, z_loan(expression), z_move(closure), NULL) != Z_OK)
        return NO_DAEMON;
    int code;
    json_t *id = begin(session, holder, side, &code);
    if (id != NULL) {
        char chosen[128];
        snprintf(chosen, sizeof chosen, "{\"id\": \"%s\"}", json_string_value(id));
        code = follow(session, chosen, json_string_value(id), z_loan(ring));
        json_decref(id);
    }
    z_drop(z_move(progress));
    z_drop(z_move(ring));
    z_drop(z_move(token));
    return code;
}
