/* What robot.c and square.c share. */
#ifndef ROBOT_H
#define ROBOT_H

#include <jansson.h>
#include <zenoh-pico.h>

/* Exit codes, those of sysexits.h where it has one. */
enum { DONE = 0, REFUSED = 1, USAGE = 64, WRONG_DATA = 65, NO_DAEMON = 69, WILL_NOT_MOVE = 75 };

const char *endpoint(void);
const char *full_key(const char *name, char key[256]);

/* The message that a payload holds; NULL where it is no such message, and `error` says why. */
json_t *read_message(const char *name, const char *data, size_t length, json_error_t *error);
json_t *read_sample(const char *name, const z_loaned_sample_t *sample);

/* WILL_NOT_MOVE where the status says so, else DONE. */
int check_status(json_t *status);
bool open_session(z_owned_session_t *session);
/* Drives; may replace the session by a new one. */
int drive_square(z_owned_session_t *session, double side);

#endif
