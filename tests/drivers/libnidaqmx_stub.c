/* What the driver of NI boards needs of NI-DAQmx's C library, for boards "Dev1" and "Dev1b". Sample s reads s mV on the first channel and
 * 1 V + s mV on the second, the buffer holds 1000 samples, samples 100 to 249 have been overwritten and 400 has not come yet. Functions for
 * attributes are variadic in the original. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

static char problem[200];
static int32_t offset, by_number, overwrites;
static int tasks, running;

static int32_t fail(int32_t code, const char *text, const char *name) {
    snprintf(problem, sizeof problem, "%s\nName: %s", text, name);
    return code;
}

static int32_t string(const char *value, char *into, uint32_t size) {
    if (size) strncpy(into, value, size);
    return size ? 0 : (int32_t)strlen(value) + 1;
}

static int32_t known(const char *name) {
    return strncmp(name, "Dev1", 4) ? fail(-200220, "Device identifier is invalid.", name) : 0;
}

int32_t DAQmxGetExtendedErrorInfo(char *into, uint32_t size) { return string(problem, into, size); }

int32_t stub_tasks(void) { return tasks * 10 + running; }

int32_t DAQmxGetSystemInfoAttribute(int32_t attribute, void *into, uint32_t size) {
    if (attribute == 0x193b) return string("Dev1, Dev1b", into, size);
    *(uint32_t *)into = 25; /* the version */
    return 0;
}

int32_t DAQmxGetDeviceAttribute(const char *name, int32_t attribute, void *into, uint32_t size) {
    if (known(name)) return known(name);
    if (attribute == 0x631) return string("PCI-6251", into, size);
    *(uint32_t *)into = attribute == 0x632 ? 0xABC123 : 0;
    return 0;
}

int32_t DAQmxCreateTask(const char *name, void **task) { *task = (void *)(intptr_t)++tasks; return 0; }
int32_t DAQmxClearTask(void *task) { tasks--; return 0; }
int32_t DAQmxStartTask(void *task) { running++; return 0; }
int32_t DAQmxStopTask(void *task) { running--; return 0; }
int32_t DAQmxTaskControl(void *task, int32_t action) { return 0; }
int32_t DAQmxGetTaskAttribute(void *task, int32_t attribute, char *into, uint32_t size) { return string("task", into, size); }

int32_t DAQmxCreateAIVoltageChan(void *task, const char *channel, const char *name, int32_t wiring, double low, double high, int32_t units,
                                 const char *scale) {
    return wiring == 10106 && low == -10 && high == 10 ? known(channel) : fail(-200077, "Not differential at 10 V.", channel);
}

int32_t DAQmxCfgSampClkTiming(void *task, const char *source, double rate, int32_t edge, int32_t mode, uint64_t samples) {
    return rate == 1000 && mode == 10123 && samples == 1000 ? 0 : fail(-200077, "Not 1 kHz without end.", source);
}

int32_t DAQmxGetTimingAttribute(void *task, int32_t attribute, double *into) { *into = 1000; return 0; }
int32_t DAQmxSetBufferAttribute(void *task, int32_t attribute, uint32_t value) { return 0; }
int32_t DAQmxGetBufferAttribute(void *task, int32_t attribute, uint32_t *into) { *into = 1000; return 0; }
int32_t DAQmxGetReadAttribute(void *task, int32_t attribute, uint64_t *into) { *into = 1250; return 0; }

int32_t DAQmxSetReadAttribute(void *task, int32_t attribute, int32_t value) {
    if (attribute == 0x190a) by_number = value == 10424;
    if (attribute == 0x190b) offset = value;
    if (attribute == 0x1211) overwrites = value == 10252;
    return 0;
}

int32_t DAQmxCreateCOPulseChanTicks(void *task, const char *counter, const char *name, const char *source, int32_t idle, int32_t delay,
                                    int32_t low, int32_t high) {
    return strcmp(source, "/Dev1/20MHzTimebase") ? fail(-200077, "Not the 20 MHz.", source) : known(counter);
}

int32_t DAQmxCfgImplicitTiming(void *task, int32_t mode, uint64_t samples) { return 0; }
int32_t DAQmxCfgDigEdgeStartTrig(void *task, const char *source, int32_t edge) { return 0; }

int32_t DAQmxReadAnalogF64(void *task, int32_t n, double timeout, int32_t fill, double *into, uint32_t size, int32_t *came, void *none) {
    *came = 0;
    if (!by_number || !overwrites) return fail(-200077, "Not read by number.", "");
    if (offset + n > 100 && offset < 250) return fail(-200279, "The application is not able to keep up.", "");
    if (offset + n > 400) return fail(-200284, "Some or all of the samples requested have not yet been acquired.", "");
    for (int i = 0; i < n; i++) {
        into[i] = (offset + i) * 1e-3;
        into[n + i] = 1 + (offset + i) * 1e-3;
    }
    *came = n;
    return 0;
}
