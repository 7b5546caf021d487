/* Reads messages, and refuses what is none. */
#include <stdio.h>
#include <string.h>

#include "robot.h"

/* Jansson's formats are the types: I integer, F number, s text, b truth, o anything, ! no more. */
static bool is_pose(json_t *root, json_error_t *error) {
    json_int_t stamp_ns, seq;
    const char *frame, *child;
    double n[12];
    return json_unpack_ex(root, error, 0, "{s:I, s:I, s:s, s:s, s:F, s:F, s:F, s:[FFFFFFFFF!]}",
                          "stamp_ns", &stamp_ns, "seq", &seq, "frame_id", &frame,
                          "child_frame_id", &child, "x", &n[0], "y", &n[1], "theta", &n[2],
                          "covariance", &n[3], &n[4], &n[5], &n[6], &n[7], &n[8], &n[9], &n[10],
                          &n[11]) == 0 &&
           stamp_ns >= 0 && seq >= 0;
}

static bool is_status(json_t *root, json_error_t *error) {
    json_int_t stamp_ns, since_ns;
    const char *state, *why;
    json_t *driver, *group;
    if (json_unpack_ex(root, error, 0, "{s:I, s:s, s:o, s:I, s:s, s:o, s:o, s:o, s:o}", "stamp_ns",
                       &stamp_ns, "state", &state, "driver", &driver, "since_ns", &since_ns, "why",
                       &why, "board", &group, "link", &group, "command", &group, "bus",
                       &group) != 0 ||
        stamp_ns < 0)
        return false;
    return json_is_string(driver) || json_is_null(driver);
}

static bool is_reply(json_t *root, json_error_t *error) {
    int success;
    const char *message;
    return json_unpack_ex(root, error, 0, "{s:b, s:s}", "success", &success, "message",
                          &message) == 0;
}

json_t *read_message(const char *name, const char *data, size_t length, json_error_t *error) {
    json_t *root = json_loadb(data, length, 0, error);
    if (root == NULL) return NULL;
    snprintf(error->text, sizeof error->text, "a value is out of its range");
    bool right = strcmp(name, "PoseSample") == 0     ? is_pose(root, error)
                 : strcmp(name, "StatusSample") == 0 ? is_status(root, error)
                                                     : is_reply(root, error);
    if (right) return root;
    json_decref(root);
    return NULL;
}

json_t *read_sample(const char *name, const z_loaned_sample_t *sample) {
    z_owned_string_t text;
    json_error_t error;
    if (z_bytes_to_string(z_sample_payload(sample), &text) != Z_OK) return NULL;
    json_t *root = read_message(name, z_string_data(z_loan(text)), z_string_len(z_loan(text)), &error);
    z_drop(z_move(text));
    return root;
}

int check_status(json_t *status) {
    const char *state = json_string_value(json_object_get(status, "state"));
    /* Anything else, a state of a later version too, is one in which the robot may not drive. */
    static const char *const drivable[] = {"waiting", "standing", "driving", "stopping"};
    for (size_t i = 0; i < sizeof drivable / sizeof *drivable; i++)
        if (strcmp(state, drivable[i]) == 0) return DONE;
    fprintf(stderr, "The robot will not move. It is %s: %s\n", state,
            json_string_value(json_object_get(status, "why")));
    return WILL_NOT_MOVE;
}
