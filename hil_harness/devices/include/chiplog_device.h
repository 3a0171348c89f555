/* chiplog_device.h: the C interface of a device under test that chiplog loads as a shared library.
 *
 * A device exports three functions: chiplog_init, chiplog_step and chiplog_odometry. The harness
 * calls chiplog_init once, then chiplog_step once per tick, and never two of them at a time. Every
 * loaded device has its own copy of the library, so static variables are the device's own state.
 *
 *     gcc -std=c99 -Wall -Wextra -pedantic -shared -fPIC -I"$(python -m hil_harness.devices)" \
 *         -o node.so node.c
 *     chiplog run --device lib:./node.so ...
 *
 * Needs C99 and <stdint.h>; C++ may include it too.
 */
#ifndef CHIPLOG_DEVICE_H
#define CHIPLOG_DEVICE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32)
#define CHIPLOG_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define CHIPLOG_EXPORT __attribute__((visibility("default")))
#else
#define CHIPLOG_EXPORT
#endif

/* Changes whenever a struct or a function below changes. chiplog_init returns it. */
#define CHIPLOG_ABI_VERSION 1

/* The most frames that one call of chiplog_step may be given or may answer. */
#define CHIPLOG_MAX_FRAMES 256

#define CHIPLOG_FRAME_EXTENDED 0x01u /* a 29-bit identifier; without it, 11 bits */
#define CHIPLOG_FRAME_REMOTE 0x02u   /* a remote frame: length, but no data */

/* One classic CAN frame; 24 bytes without padding. */
typedef struct chiplog_frame {
    uint64_t timestamp_us; /* when it was received; ignored in frames that the device sends */
    uint32_t id;           /* 11 or 29 bits */
    uint8_t flags;         /* CHIPLOG_FRAME_..., other bits zero */
    uint8_t length;        /* bytes of data, 0 to 8 */
    uint8_t reserved[2];   /* zero */
    uint8_t data[8];       /* bytes beyond length are ignored */
} chiplog_frame;

/* How chiplog_odometry filled in its pose. */
#define CHIPLOG_POSE_NONE 0 /* nothing: there is no pose yet */
#define CHIPLOG_POSE_SI 1   /* x_m, y_m and heading_rad */
#define CHIPLOG_POSE_RAW 2  /* x_m_q32, y_m_q32 and heading_turn_q32 */

/* Where the device believes the robot is: x forward and y left of the start, heading
 * counter-clockwise. Fill in one half and return its kind. */
typedef struct chiplog_pose {
    double x_m;
    double y_m;
    double heading_rad;
    int64_t x_m_q32;          /* metres times 2^32 */
    int64_t y_m_q32;          /* metres times 2^32 */
    int64_t heading_turn_q32; /* turns times 2^32 */
} chiplog_pose;

/* Starts afresh; the harness steps the device every tick_period_us microseconds of bus time.
 * Returns CHIPLOG_ABI_VERSION, or a negative number of the device's own to refuse. */
CHIPLOG_EXPORT int32_t chiplog_init(uint32_t tick_period_us);

/* Runs one tick at bus time now_us. received[0 .. received_count-1] are the frames since the last
 * tick, in the order of the bus. The device writes its answer to sent[0 ..], no more than
 * sent_capacity frames.
 * Returns the number of frames written, or a negative number of the device's own on failure. */
CHIPLOG_EXPORT int32_t chiplog_step(uint64_t now_us, const chiplog_frame *received,
                                    uint32_t received_count, chiplog_frame *sent,
                                    uint32_t sent_capacity);

/* Fills in the present pose.
 * Returns CHIPLOG_POSE_..., or a negative number of the device's own on failure. */
CHIPLOG_EXPORT int32_t chiplog_odometry(chiplog_pose *pose);

#ifdef __cplusplus
}
#endif

#endif
