import java.lang.reflect.Constructor;
import java.lang.reflect.Field;

/** Prints "DECODED CHANNEL type utime sender_id seq" for each event of an LCM log, decoded the way lcm-spy does it. */
class DecodeLog {
    public static void main(String[] arguments) throws Exception {
        lcm.spy.LCMTypeDatabase types = new lcm.spy.LCMTypeDatabase();
        lcm.logging.Log log = new lcm.logging.Log(arguments[0], "r");
        try {
            while (true) {
                lcm.logging.Log.Event event = log.readNext();
                long fingerprint = new lcm.lcm.LCMDataInputStream(event.data).readLong();
                Class<?> type = types.getClassByFingerprint(fingerprint);
                if (type == null) {
                    System.out.println("DECODED " + event.channel + " undecodable");
                    continue;
                }
                Constructor<?> constructor = type.getConstructor(byte[].class);
                Object message = constructor.newInstance((Object) event.data);
                StringBuilder line = new StringBuilder("DECODED " + event.channel + " " + type.getSimpleName());
                for (String name : new String[] {"utime", "sender_id", "seq"}) {
                    Field field = type.getField(name);
                    line.append(' ').append(field.getLong(message));
                }
                System.out.println(line);
            }
        } catch (java.io.EOFException end) {
            return;
        }
    }
}
