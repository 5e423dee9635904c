/* What moves bytes: a descriptor of a terminal or a socket, as hil/wire/fd_link.py and hil/wire/datagram_link.py have
   it, or Python. */

#ifndef TURN_LINK_H
#define TURN_LINK_H

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "can.h"

#ifndef SO_TIMESTAMPNS
#define SO_TIMESTAMPNS 35
#endif

#define BATCH 256          /* datagrams taken in one call at most */
#define LARGEST 65536      /* bytes of a datagram */
#define CAN_TROUBLE 0x20000000u /* in an identifier: an error frame of the driver; linux/can.h */
#define CAN_BUS_OFF 0x40u
#define ROOM_NS 50000      /* a full queue of an interface cannot be waited for, only tried again */

enum { NOTHING = 0, CAME = 1, WOKEN = -1, CLOSED = -2, RAISED = -3 };

static int64_t clock_ns(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static int64_t now_ns(void)
{
    return clock_ns(CLOCK_MONOTONIC);
}

/* Wait until there is something to read. */
static int await(const link_t *link, int64_t timeout_ns)
{
    struct pollfd watched[2] = {{(int)link->fd, POLLIN, 0}, {(int)link->waker, POLLIN, 0}};
    struct timespec left = {timeout_ns / 1000000000, timeout_ns % 1000000000};
    int found = ppoll(watched, link->waker >= 0 ? 2 : 1, &left, NULL);
    if (found < 0 || (link->waker >= 0 && watched[1].revents != 0))
        return WOKEN;
    return watched[0].revents != 0 ? CAME : NOTHING;
}

static int closed(link_t *link, int error)
{
    link->failure = error;
    return CLOSED;
}

static int read_stream(turn_t *turn)
{
    receiver_t *rx = turn->receiver;
    ssize_t size = read((int)turn->link.fd, rx->rest + rx->held, READ_SIZE);
    if (size < 0)
        return errno == EAGAIN || errno == EINTR ? NOTHING : closed(&turn->link, errno);
    if (size == 0)
        return closed(&turn->link, 0);
    turn->received_ns = now_ns();
    feed(rx, &turn->batch, (size_t)size);
    return CAME;
}

/* The kernel's stamp of a datagram, on the monotonic clock; 0 without one. */
static int64_t stamp_ns(struct msghdr *message)
{
    for (struct cmsghdr *part = CMSG_FIRSTHDR(message); part != NULL; part = CMSG_NXTHDR(message, part)) {
        if (part->cmsg_level == SOL_SOCKET && part->cmsg_type == SO_TIMESTAMPNS) {
            struct timespec stamp;
            memcpy(&stamp, CMSG_DATA(part), sizeof stamp);
            return now_ns() - (clock_ns(CLOCK_REALTIME) - ((int64_t)stamp.tv_sec * 1000000000 + stamp.tv_nsec));
        }
    }
    return 0;
}

/* What came in one datagram: NOTHING from a stranger. */
static int take_datagram(turn_t *turn, const struct sockaddr_in *source, uint8_t *data, size_t size)
{
    receiver_t *rx = turn->receiver;
    if (turn->link.kind == LINK_CAN) {
        uint32_t identifier;
        if (size < RECORD_SIZE) /* a classic frame, or one that says what is wrong with the bus */
            memset(data + size, 0, RECORD_SIZE - size);
        memcpy(&identifier, data, sizeof identifier);
        if (size < RECORD_SIZE && (identifier & CAN_TROUBLE) != 0u) {
            turn->link.trouble = identifier;
            if ((identifier & CAN_BUS_OFF) != 0u)
                return CLOSED;
        }
        feed_record(rx, turn->can, &turn->batch, data);
        return CAME;
    }
    if (source->sin_addr.s_addr != turn->link.peer_ip || source->sin_port != turn->link.peer_port) {
        turn->link.strangers++;
        return NOTHING;
    }
    for (size_t at = 0; at < size; at += READ_SIZE) {
        size_t taken = size - at < READ_SIZE ? size - at : READ_SIZE;
        memcpy(rx->rest + rx->held, data + at, taken);
        feed(rx, &turn->batch, taken);
    }
    return size > 0u ? CAME : NOTHING;
}

/* All datagrams that are there and find room. */
static int read_datagrams(turn_t *turn)
{
    uint8_t data[LARGEST];
    bool came = false;
    for (int k = 0; k < BATCH && has_room(&turn->batch); k++) {
        struct sockaddr_in source = {0};
        struct iovec part = {data, sizeof data};
        union {
            struct cmsghdr aligned;
            char room[CMSG_SPACE(sizeof(struct timespec))];
        } stamped;
        struct msghdr message = {.msg_name = &source,
                                 .msg_namelen = sizeof source,
                                 .msg_iov = &part,
                                 .msg_iovlen = 1,
                                 .msg_control = &stamped,
                                 .msg_controllen = sizeof stamped};
        ssize_t size = recvmsg((int)turn->link.fd, &message, 0);
        if (size < 0) {
            if (errno != EAGAIN && errno != EINTR && !came)
                return closed(&turn->link, errno);
            break;
        }
        int taken = take_datagram(turn, &source, data, (size_t)size);
        if (taken == CLOSED)
            return closed(&turn->link, 0);
        if (taken != CAME)
            continue;
        int64_t stamp = stamp_ns(&message);
        turn->received_ns = stamp != 0 ? stamp : now_ns();
        came = true;
    }
    return came ? CAME : NOTHING;
}

static int read_bytes(turn_t *turn, int64_t timeout_ns)
{
    receiver_t *rx = turn->receiver;
    int64_t room = turn->can == NULL ? READ_SIZE : READ_SIZE - READ_SIZE % (int64_t)RECORD_SIZE;
    int64_t size = turn->link.receive(timeout_ns, rx->rest + rx->held, room);
    if (size < 0)
        return RAISED;
    if (size == 0)
        return NOTHING;
    if (turn->can == NULL)
        feed(rx, &turn->batch, (size_t)size);
    else
        feed_records(rx, turn->can, &turn->batch, rx->rest, (size_t)size);
    return CAME;
}

/* What the board in this process has said, which comes at once or not at all. */
static int read_memory(turn_t *turn)
{
    receiver_t *rx = turn->receiver;
    link_t *link = &turn->link;
    int64_t left = link->answered - link->taken, size = left < READ_SIZE ? left : READ_SIZE;
    if (size == 0)
        return link->elsewhere ? read_bytes(turn, 0) : NOTHING;
    memcpy(rx->rest + rx->held, link->answers + link->taken, (size_t)size);
    link->taken += size;
    if (link->taken == link->answered)
        link->taken = link->answered = 0;
    turn->received_ns = now_ns();
    feed(rx, &turn->batch, (size_t)size);
    return CAME;
}

static int write_memory(link_t *link, const uint8_t *data, size_t size)
{
    if (!link->elsewhere && link->answered == 0) {
        int64_t said = link->answer(link->board, data, (int64_t)size, link->answers);
        if (said >= 0) {
            link->answered = said;
            return CAME;
        }
    }
    link->elsewhere = 1;
    return link->send(data, (int64_t)size) < 0 ? RAISED : CAME;
}

/* Wait for something to come, and take it into the batch. */
static int receive(turn_t *turn, int64_t timeout_ns)
{
    link_t *link = &turn->link;
    if (link->kind == LINK_MEMORY)
        return read_memory(turn);
    if (link->kind == LINK_BYTES)
        return read_bytes(turn, timeout_ns);
    int found = await(link, timeout_ns);
    if (found != CAME)
        return found;
    return link->kind == LINK_STREAM ? read_stream(turn) : read_datagrams(turn);
}

static int write_stream(link_t *link, const uint8_t *data, size_t size)
{
    while (size > 0u) {
        ssize_t written = write((int)link->fd, data, size);
        if (written >= 0) {
            data += written;
            size -= (size_t)written;
        } else if (errno == EAGAIN) {
            struct pollfd watched = {(int)link->fd, POLLOUT, 0}; /* tells a hang-up apart */
            if (poll(&watched, 1, -1) > 0 && (watched.revents & ~POLLOUT) != 0)
                return closed(link, 0);
        } else if (errno != EINTR) {
            return closed(link, errno);
        }
    }
    return CAME;
}

static int write_datagram(link_t *link, const uint8_t *data, size_t size)
{
    struct sockaddr_in group = {.sin_family = AF_INET, .sin_port = link->group_port, .sin_addr = {link->group_ip}};
    bool can = link->kind == LINK_CAN; /* a bus has no addresses */
    while (sendto((int)link->fd, data, size, 0, can ? NULL : (const struct sockaddr *)&group,
                  can ? 0u : (socklen_t)sizeof group) < 0) {
        if (errno == EAGAIN || errno == ENOBUFS)
            nanosleep(&(struct timespec){0, ROOM_NS}, NULL);
        else if (errno != EINTR)
            return closed(link, errno);
    }
    return CAME;
}

typedef struct {
    uint8_t bytes[RECORD_SIZE]; /* a frame of the host, which is one piece */
    size_t size;
} sealed_t;

static void put_down(void *context, const uint8_t *data, size_t size)
{
    sealed_t *sealed = context;
    memcpy(sealed->bytes + sealed->size, data, size);
    sealed->size += size;
}

/* A message, on its way; `sent_ns` is when. */
static int send_message(turn_t *turn, uint8_t type, const uint8_t *payload, size_t size)
{
    link_t *link = &turn->link;
    sealed_t out = {.size = 0};
    uint16_t seq = (uint16_t)turn->seq;
    uint32_t tick = (uint32_t)turn->receiver->tick;
    hil_frame frame = {type, true, seq, tick, payload, size};
    if (turn->can != NULL)
        out.size = record_of(turn->can, type, seq, tick, payload, size, out.bytes);
    else
        hil_frame_write(&frame, put_down, &out);
    turn->types[turn->seq] = type;
    turn->seq = (turn->seq + 1) & 0xFFFF;
    int done;
    if (link->kind == LINK_BYTES)
        done = link->send(out.bytes, (int64_t)out.size) < 0 ? RAISED : CAME;
    else if (link->kind == LINK_MEMORY)
        done = write_memory(link, out.bytes, out.size);
    else
        done = link->kind == LINK_STREAM ? write_stream(link, out.bytes, out.size)
                                         : write_datagram(link, out.bytes, out.size);
    turn->sent_ns = now_ns();
    return done;
}

#endif
