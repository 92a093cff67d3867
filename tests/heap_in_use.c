// What a program's heap has in use and what was freed and is kept, every ten seconds, into $HEAP_IN_USE.PID: for LD_PRELOAD. How: docs/RELIABILITY.md, "Long runs".
#include <malloc.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static void *watch(void *name) {
    FILE *file = fopen(name, "a");
    for (int seconds = 0; file; seconds += 10) {
        struct mallinfo2 heap = mallinfo2();
        fprintf(file, "%d s: %zu bytes in use, %zu freed and kept, %zu in maps\n", seconds, heap.uordblks, heap.fordblks, heap.hblkhd);
        fflush(file);
        sleep(10);
    }
    return NULL;
}

__attribute__((constructor)) static void begin(void) {
    static char name[4096];
    pthread_t thread;
    if (getenv("HEAP_IN_USE")) {
        snprintf(name, sizeof name, "%s.%d", getenv("HEAP_IN_USE"), getpid());
        pthread_create(&thread, NULL, watch, name);
    }
}
