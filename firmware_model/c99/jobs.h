/**
 * @file jobs.h
 * @brief What the job runner asks of the machine it runs on; jobs.c says what a job is.
 */
#ifndef CHIPLOG_JOBS_H
#define CHIPLOG_JOBS_H

#include <stdint.h>

/** @brief Read exactly so many bytes; 0 at the end of the jobs, or when they are cut short. */
int machine_read(void *bytes, uint32_t count);

/** @brief Write so many bytes; 0 when that fails. */
int machine_write(const void *bytes, uint32_t count);

/** @brief A clock that counts down through 24 bits, one unit for each 40 instructions; else 0. */
uint32_t machine_clock(void);

/** @brief Run all jobs; 0 when they were well formed. */
int run_jobs(void);

#endif
