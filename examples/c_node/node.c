/* A firmware of your own, in C: dead reckoning from the wheels alone.
 *
 * build_node.py writes the two headers that this file does not carry itself: chiplog_bus.h (how frames
 * are laid out, from the DBC, by cantools) and facts.h (the robot's measures from robot.toml, the
 * frames' identifiers for end-to-end protection from the DBC).
 */
#include "chiplog_bus.h"
#include "chiplog_device.h"
#include "facts.h"

#include <math.h>
#include <stdbool.h>

static const double PI = 3.14159265358979323846;

static struct {
    bool has_baseline;
    uint16_t left_count;
    uint16_t right_count;
    uint8_t tick_counter;
    double x_m;
    double y_m;
    double heading_rad;
} node;

/* CRC of AUTOSAR E2E Profile 1: polynomial 0x1D over the data ID, low byte first, and all bytes
 * of the frame but its own. */
static uint8_t crc8_step(uint8_t crc, uint8_t byte)
{
    crc = (uint8_t)(crc ^ byte);
    for (int bit = 0; bit < 8; bit++) {
        crc = (uint8_t)((crc & 0x80u) ? (uint8_t)(crc << 1) ^ 0x1Du : (uint8_t)(crc << 1));
    }
    return crc;
}

static uint8_t frame_crc(uint16_t data_id, const uint8_t *data, uint8_t length)
{
    uint8_t crc = crc8_step(0, (uint8_t)(data_id & 0xFFu));
    crc = crc8_step(crc, (uint8_t)(data_id >> 8));
    for (uint8_t i = 1; i < length; i++) {
        crc = crc8_step(crc, data[i]);
    }
    return crc;
}

/* The signed difference of two counters that wrap at 16 bits. */
static int32_t ticks_between(uint16_t before, uint16_t now)
{
    uint16_t difference = (uint16_t)(now - before);
    return difference < 0x8000u ? (int32_t)difference : (int32_t)difference - 0x10000;
}

static void take_encoder(const chiplog_frame *frame)
{
    struct chiplog_bus_encoder_t encoder;

    if (frame->length != CHIPLOG_BUS_ENCODER_LENGTH ||
        frame->data[0] != frame_crc(ENCODER_DATA_ID, frame->data, frame->length) ||
        chiplog_bus_encoder_unpack(&encoder, frame->data, frame->length) != 0) {
        return; /* damaged: as if it had never come */
    }
    if (!chiplog_bus_encoder_left_count_is_in_range(encoder.left_count) ||
        !chiplog_bus_encoder_right_count_is_in_range(encoder.right_count)) {
        return; /* marked invalid by the sender */
    }
    node.tick_counter = encoder.tick_counter;
    uint16_t left_count = (uint16_t)encoder.left_count;
    uint16_t right_count = (uint16_t)encoder.right_count;
    if (node.has_baseline) {
        const double metres_per_tick = 2.0 * PI * WHEEL_RADIUS_M / TICKS_PER_REV;
        double left_m = ticks_between(node.left_count, left_count) * metres_per_tick;
        double right_m = ticks_between(node.right_count, right_count) * metres_per_tick;
        double distance_m = 0.5 * (left_m + right_m);
        double turn_rad = (right_m - left_m) / WHEELBASE_M;
        node.x_m += distance_m * cos(node.heading_rad + 0.5 * turn_rad);
        node.y_m += distance_m * sin(node.heading_rad + 0.5 * turn_rad);
        node.heading_rad += turn_rad;
    }
    node.has_baseline = true;
    node.left_count = left_count;
    node.right_count = right_count;
}

static void finish(chiplog_frame *frame, uint32_t id, uint16_t data_id, int length)
{
    frame->id = id;
    frame->flags = 0;
    frame->length = (uint8_t)length;
    frame->data[0] = frame_crc(data_id, frame->data, frame->length);
}

int32_t chiplog_init(uint32_t tick_period_us)
{
    (void)tick_period_us; /* wheels tell distance, whatever the time */
    node.has_baseline = false;
    node.tick_counter = 0;
    node.x_m = node.y_m = node.heading_rad = 0.0;
    return CHIPLOG_ABI_VERSION;
}

int32_t chiplog_step(uint64_t now_us, const chiplog_frame *received, uint32_t received_count,
                     chiplog_frame *sent, uint32_t sent_capacity)
{
    struct chiplog_bus_odometry_x_t x = {0};
    struct chiplog_bus_odometry_y_t y = {0};
    struct chiplog_bus_odometry_heading_t heading = {0};
    double turns;

    (void)now_us;
    if (sent_capacity < 3) {
        return -1;
    }
    for (uint32_t i = 0; i < received_count; i++) {
        if (received[i].id == CHIPLOG_BUS_ENCODER_FRAME_ID && received[i].flags == 0) {
            take_encoder(&received[i]);
        }
    }
    if (!node.has_baseline) {
        return 0; /* no pose to tell of yet */
    }
    turns = node.heading_rad / (2.0 * PI);
    turns -= floor(turns + 0.5); /* -0.5 <= turns < 0.5 */
    x.tick_counter = y.tick_counter = heading.tick_counter = node.tick_counter;
    x.x_m = chiplog_bus_odometry_x_x_m_encode(node.x_m);
    y.y_m = chiplog_bus_odometry_y_y_m_encode(node.y_m);
    heading.heading_turn = chiplog_bus_odometry_heading_heading_turn_encode(turns);
    finish(&sent[0], CHIPLOG_BUS_ODOMETRY_X_FRAME_ID, ODOMETRY_X_DATA_ID,
           chiplog_bus_odometry_x_pack(sent[0].data, &x, sizeof sent[0].data));
    finish(&sent[1], CHIPLOG_BUS_ODOMETRY_Y_FRAME_ID, ODOMETRY_Y_DATA_ID,
           chiplog_bus_odometry_y_pack(sent[1].data, &y, sizeof sent[1].data));
    finish(&sent[2], CHIPLOG_BUS_ODOMETRY_HEADING_FRAME_ID, ODOMETRY_HEADING_DATA_ID,
           chiplog_bus_odometry_heading_pack(sent[2].data, &heading, sizeof sent[2].data));
    return 3;
}

int32_t chiplog_odometry(chiplog_pose *pose)
{
    if (!node.has_baseline) {
        return CHIPLOG_POSE_NONE;
    }
    pose->x_m = node.x_m;
    pose->y_m = node.y_m;
    pose->heading_rad = node.heading_rad;
    return CHIPLOG_POSE_SI;
}
