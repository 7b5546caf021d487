/* Drives to four corners, in a frame that begins where the robot stands. */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <time.h>

#include "robot.h"

static const double PERIOD_S = 0.05;
static const double STALE_S = 0.3; /* an older pose does not say where the robot is now */
static const double REOPEN_S = 2.0;
static const double PATIENCE_S = 30.0;
static const double PI = 3.14159265358979323846;

typedef struct {
    z_owned_session_t *session;
    bool connected;
    double opened_s;
    z_owned_publisher_t commands;
    z_owned_subscriber_t pose_subscriber, status_subscriber;
    z_owned_ring_handler_sample_t poses, statuses; /* rings of one: the newest sample */
    bool has_pose;
    json_int_t seq;
    double pose[3];     /* the newest: x, y, theta */
    double x, y, theta; /* the same, from where the square began */
    double arrived_s;
} Square;

static volatile sig_atomic_t ended = 0;

static void on_signal(int number) { ended = number; }

static double now_s(clockid_t clock) {
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec + (double)now.tv_nsec / 1e9;
}

static void send_command(Square *square, double vx, double wz) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (!square->connected) return;
    char text[160];
    snprintf(text, sizeof text,
             "{\"vx\": %.4f, \"wz\": %.4f, \"stamp_ns\": %lld%09ld, \"source\": \"square\"}", vx, wz,
             (long long)now.tv_sec, now.tv_nsec);
    z_owned_bytes_t payload;
    z_bytes_copy_from_str(&payload, text);
    z_publisher_put(z_loan(square->commands), z_move(payload), NULL);
}

/* Adds the step from the last pose to this one. */
static void follow(Square *square, json_t *sample) {
    double pose[3];
    json_int_t seq;
    json_unpack(sample, "{s:I, s:F, s:F, s:F}", "seq", &seq, "x", &pose[0], "y", &pose[1], "theta",
                &pose[2]);
    double dx = pose[0] - square->pose[0], dy = pose[1] - square->pose[1];
    double turned = pose[2] - square->pose[2], from = square->theta - square->pose[2];
    bool restarted = seq <= square->seq;
    bool was_set = hypot(dx, dy) > 0.5 || fabs(turned) > 0.5;
    if (square->has_pose && !restarted && !was_set) {
        square->x += cos(from) * dx - sin(from) * dy;
        square->y += sin(from) * dx + cos(from) * dy;
        square->theta += turned;
    }
    square->has_pose = true;
    square->seq = seq;
    for (int i = 0; i < 3; i++) square->pose[i] = pose[i];
    square->arrived_s = now_s(CLOCK_MONOTONIC);
}

static bool subscribe(const z_loaned_session_t *session, const char *name,
                      z_owned_subscriber_t *subscriber, z_owned_ring_handler_sample_t *ring) {
    char key[256];
    z_view_keyexpr_t expression;
    z_owned_closure_sample_t closure;
    return z_ring_channel_sample_new(&closure, ring, 1) == Z_OK &&
           z_view_keyexpr_from_str(&expression, full_key(name, key)) == Z_OK &&
           z_declare_subscriber(session, subscriber, z_loan(expression), z_move(closure), NULL) ==
               Z_OK;
}

static bool declare(Square *square) {
    const z_loaned_session_t *session = z_loan(*square->session);
    char key[256];
    z_view_keyexpr_t expression;
    z_view_keyexpr_from_str(&expression, full_key("cmd_vel", key));
    square->opened_s = now_s(CLOCK_MONOTONIC);
    return z_declare_publisher(session, &square->commands, z_loan(expression), NULL) == Z_OK &&
           subscribe(session, "yahboomd/pose", &square->pose_subscriber, &square->poses) &&
           subscribe(session, "yahboomd/status", &square->status_subscriber, &square->statuses);
}

static void undeclare(Square *square) {
    if (!square->connected) return;
    z_drop(z_move(square->pose_subscriber));
    z_drop(z_move(square->status_subscriber));
    z_drop(z_move(square->poses));
    z_drop(z_move(square->statuses));
    z_drop(z_move(square->commands));
    square->connected = false;
}

/* After one congestion Zenoh 1.10.2 sends no more samples to a client without QoS, which zenoh-pico
 * is, though the connection lives. A new session gets them. */
static void reopen(Square *square) {
    undeclare(square);
    z_drop(z_move(*square->session));
    square->opened_s = now_s(CLOCK_MONOTONIC);
    square->connected = open_session(square->session) && declare(square);
}

/* Sends one command, or zero where the newest pose is too old; then reads the next samples. There is
 * no other thread that sends: a loop that stalls sends nothing. */
static int step(Square *square, double vx, double wz) {
    double silent_s = now_s(CLOCK_MONOTONIC) - square->arrived_s;
    double session_s = now_s(CLOCK_MONOTONIC) - square->opened_s;
    if (silent_s > REOPEN_S && session_s > REOPEN_S) reopen(square);
    bool stale = !square->has_pose || silent_s > STALE_S;
    send_command(square, stale ? 0.0 : vx, stale ? 0.0 : wz);
    if (silent_s > PATIENCE_S) {
        fprintf(stderr, "No pose came from %s for 30 s.\n", endpoint());
        return WILL_NOT_MOVE;
    }
    z_sleep_ms((size_t)(PERIOD_S * 1000));
    if (ended) return 128 + ended;
    if (!square->connected) return DONE;
    int code = DONE;
    json_t *message;
    z_owned_sample_t sample;
    if (z_try_recv(z_loan(square->statuses), &sample) == Z_OK) {
        if ((message = read_sample("StatusSample", z_loan(sample))) != NULL) {
            code = check_status(message);
            json_decref(message);
        }
        z_drop(z_move(sample));
    }
    if (z_try_recv(z_loan(square->poses), &sample) == Z_OK) {
        if ((message = read_sample("PoseSample", z_loan(sample))) != NULL) {
            follow(square, message);
            json_decref(message);
        }
        z_drop(z_move(sample));
    }
    return code;
}

static double clamp(double value, double limit) { return fmax(-limit, fmin(limit, value)); }

static int turn_to(Square *square, double theta) {
    for (;;) {
        double error = remainder(theta - square->theta, 2 * PI);
        if (fabs(error) < 0.02) return DONE;
        int code = step(square, 0.0, clamp(copysign(0.2, error) + 3 * error, 1.2));
        if (code != DONE) return code;
    }
}

static int drive_to(Square *square, double x, double y) {
    int code = turn_to(square, atan2(y - square->y, x - square->x));
    while (code == DONE) {
        double dx = x - square->x, dy = y - square->y, distance = hypot(dx, dy);
        double error = remainder(atan2(dy, dx) - square->theta, 2 * PI);
        if (distance < 0.01 || fabs(error) > 1.0) break; /* there, or past it */
        code = step(square, fmin(0.25, 0.05 + 2.5 * distance), clamp(2 * error, 1.0));
    }
    return code;
}

int drive_square(z_owned_session_t *session, double side) {
    Square square = {.session = session, .arrived_s = now_s(CLOCK_MONOTONIC)};
    square.connected = declare(&square);
    if (!square.connected) {
        fprintf(stderr, "The session with %s was lost.\n", endpoint());
        return NO_DAEMON;
    }
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);
    const double corners[4][2] = {{side, 0.0}, {side, side}, {0.0, side}, {0.0, 0.0}};
    int code = DONE;
    for (int i = 0; i < 4 && code == DONE; i++) {
        printf("driving to %.2f, %.2f\n", corners[i][0], corners[i][1]);
        fflush(stdout);
        code = drive_to(&square, corners[i][0], corners[i][1]);
    }
    if (code == DONE) code = turn_to(&square, 0.0);
    send_command(&square, 0.0, 0.0); /* however it ended */
    if (code == DONE)
        printf("{\"x\": %.4f, \"y\": %.4f, \"theta\": %.4f}\n", square.x, square.y, square.theta);
    undeclare(&square);
    return code;
}
