#define _DEFAULT_SOURCE /* struct ifreq */

#include "can_socket.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

bool can_open(can_socket *c, const char *interface, unsigned match, unsigned mask) {
    struct ifreq request;
    struct sockaddr_can address;
    struct can_filter filter = {match, CAN_EFF_FLAG | CAN_RTR_FLAG | mask};
    int on = 1;
    c->first = c->queued = 0;
    if (strlen(interface) >= sizeof request.ifr_name) {
        errno = ENODEV;
        return false;
    }
    c->descriptor = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (c->descriptor < 0)
        return false;
    memset(&request, 0, sizeof request);
    strcpy(request.ifr_name, interface);
    if (ioctl(c->descriptor, SIOCGIFINDEX, &request))
        return false;
    memset(&address, 0, sizeof address);
    address.can_family = AF_CAN;
    address.can_ifindex = request.ifr_ifindex;
    return !setsockopt(c->descriptor, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) &&
           !setsockopt(c->descriptor, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) &&
           !bind(c->descriptor, (struct sockaddr *)&address, sizeof address) &&
           !fcntl(c->descriptor, F_SETFL, O_NONBLOCK);
}

size_t can_free(void *context) {
    const can_socket *c = context;
    return CAN_QUEUE - c->queued;
}

void can_put(void *context, const hil_can_frame *frame) {
    can_socket *c = context;
    c->queue[(c->first + c->queued++) % CAN_QUEUE] = *frame;
}

void can_flush(can_socket *c) {
    while (c->queued > 0) {
        const hil_can_frame *frame = &c->queue[c->first];
        struct canfd_frame out;
        memset(&out, 0, sizeof out);
        out.can_id = frame->identifier;
        out.len = frame->length;
        out.flags = frame->fd ? CANFD_BRS : 0;
        memcpy(out.data, frame->data, frame->length);
        if (write(c->descriptor, &out, frame->fd ? CANFD_MTU : CAN_MTU) < 0)
            return; /* the interface's queue is full: later */
        c->first = (c->first + 1u) % CAN_QUEUE;
        c->queued--;
    }
}

bool can_read(can_socket *c, hil_can_frame *frame) {
    struct canfd_frame in;
    ssize_t got = read(c->descriptor, &in, sizeof in);
    if (got != (ssize_t)CANFD_MTU && got != (ssize_t)CAN_MTU)
        return false;
    frame->identifier = (uint16_t)(in.can_id & CAN_SFF_MASK);
    frame->fd = got == (ssize_t)CANFD_MTU;
    frame->length = in.len;
    if (in.len > (frame->fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN))
        return false;
    memcpy(frame->data, in.data, in.len);
    return true;
}
