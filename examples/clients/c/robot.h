/* What the files of this program share. */
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
/* The answer to a query, as `name` or as a ServiceReply; NULL where none came. */
json_t *query(const z_loaned_session_t *session, const char *key_name, const char *payload,
              const char *name, bool *is_sample);
/* The same, with words on standard error where none came. */
json_t *ask(const z_loaned_session_t *session, const char *key_name, const char *payload,
            const char *name, bool *is_sample);
/* Drives a square by moves. */
int drive_moves(const z_loaned_session_t *session, double side);
/* Drives; may replace the session by a new one. */
int drive_square(z_owned_session_t *session, double side);

#endif
